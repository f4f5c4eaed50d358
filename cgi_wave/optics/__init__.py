"""The instrument as data: file, glass, coatings, resolved surfaces."""

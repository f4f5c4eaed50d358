"""Ghost paths, traced beams and the samples of their pupil fields."""

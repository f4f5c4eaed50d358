"""Ways to compute one overlap contrast, all on the same pupil fields; one module each."""

"""One file that holds a calibrated sensor: made from what there is, opened in a moment, read frame by frame."""

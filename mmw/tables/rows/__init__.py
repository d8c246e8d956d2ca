"""What sensors and channel return, as columns of the tables. One function a table; rows of one batch of frames."""

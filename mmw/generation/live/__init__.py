"""A live simulation: frames of traffic that is stepped, traced when they are looked at, and saved as a dataset."""

"""A finished dataset in the Rerun viewer (extra `viz`): what is shown, how it is drawn, and where it is opened."""

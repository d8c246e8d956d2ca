"""Looking at what was made: previews of a stage, plots of a dataset."""

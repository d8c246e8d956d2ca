"""Export to DeepMIMO."""

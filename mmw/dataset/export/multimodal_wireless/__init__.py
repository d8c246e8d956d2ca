"""Export to the published Multimodal-Wireless dataset's layout."""

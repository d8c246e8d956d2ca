"""Export to nuScenes."""

"""Compose USD stages, read them, and hold the scene on a device."""

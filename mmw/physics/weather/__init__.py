"""Describe the weather as a physical state of air, water and light."""

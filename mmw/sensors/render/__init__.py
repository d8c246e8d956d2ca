"""Render images: visibility, light, lenses, weather in front of them, and tone mapping."""

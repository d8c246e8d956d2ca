"""Read Mitsuba scenes, those of Sionna RT included."""

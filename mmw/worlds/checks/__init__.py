"""Checks of a town or of any other stage: what is wrong with it, where, and what to do."""

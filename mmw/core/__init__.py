"""Provide what every other package uses: constants, transforms, devices, errors and random keys."""

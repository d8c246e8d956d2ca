"""Compute electromagnetic fields: reflection, transmission, diffraction, scattering and attenuation."""

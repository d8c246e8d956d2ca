"""Compute path gain, RSS and SINR over surfaces."""

"""Worlds from other tools: each reader returns a `World`, which becomes an ordinary town asset."""

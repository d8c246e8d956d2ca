"""Radio channel: links, path finding (line of sight and first-order specular reflection), antennas and materials."""

"""Model fields, materials and weather, without a scene."""

"""Walk bounding volume hierarchies and describe scenes on the device."""

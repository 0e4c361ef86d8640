"""Work that is divided between the host and a device without one waiting for the other."""

"""Readers and writers of grooms: .hair, .data, .tfx, USD, PLY, OBJ, npz."""

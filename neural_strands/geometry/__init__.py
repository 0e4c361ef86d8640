"""Pure maths of cameras, strands, frames, meshes and neighbours (conventions: docs/conventions.md)."""

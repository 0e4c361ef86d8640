"""The hair model: scalp textures, alias-free UNet, compositing (paper, "Neural Strands")."""

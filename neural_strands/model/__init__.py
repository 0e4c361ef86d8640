"""The hair model: scalp textures, alias-free UNet, compositing and the renderer (paper, section 4)."""

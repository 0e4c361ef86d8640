"""The strand prior: a VAE whose decoder turns a latent into any strand (paper, "Strand Generator")."""

"""Image operators: rasterised lines and triangles, splatting, texture sampling, resampling."""

"""Line-based multi-view stereo: images to oriented 3D line segments (Nam et al. 2019)."""

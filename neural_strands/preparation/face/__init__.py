"""The face in the photographs: landmarks in 2D and 3D, the frame and the scale that follow from them."""

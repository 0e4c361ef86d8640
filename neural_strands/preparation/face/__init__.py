"""The face in the photographs: landmarks in 2D and 3D, and the scale that follows from them."""

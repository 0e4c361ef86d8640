"""Options of a preparation with the values that they may have, for the command line and for files of subjects."""

from typing import Annotated

from neural_strands.foundation.configs import Between

MetresPerUnit = Annotated[float, Between(1e-6, 1e6)]
"""Metres in one unit of the cameras."""
PupilDistance = Annotated[float, Between(40, 85)]
"""Millimetres between the person's pupils."""
LongestSide = Annotated[int, Between(256, 16384)]
"""Longer side to which larger photographs are reduced, pixels."""
FrameCount = Annotated[int, Between(3, 2000)]
"""Number of frames to take from a video."""

import time

import pytest

from neural_strands.evaluation.timing import time_function


def test_a_pause_takes_as_long_as_it_takes(device):
    calls = []
    timing = time_function(lambda: (calls.append(1), time.sleep(0.02)), device, runs=3, warm_up=2)
    assert len(calls) == 5
    assert 0.02 <= timing.fastest <= timing.median <= timing.slowest
    assert timing.peak_bytes >= 0
    with pytest.raises(ValueError, match="one run"):
        time_function(lambda: None, runs=0)

from neural_strands.editing.settings import Density, Haircut, Restyle, Wind
from neural_strands.viewer.panels.edit import described


def test_an_edit_is_listed_with_what_is_not_as_usual():
    assert described(Haircut(length=0.15)) == "haircut: length 0.15"
    assert described(Haircut(plane=(0.0, -0.07, 0.0, 0.0, -1.0, 0.0), uneven=0.0)) == "haircut: plane, uneven 0"
    assert described(Restyle(curl=1.0, region=((0.5, 0.5, 0.1),))) == "restyle: curl 1 in the painted region"
    assert described(Wind()) == "wind"
    assert described(Wind(direction=(0.0, 0.0, -1.0), strength=2.0)) == "wind: direction 0 0 -1, strength 2"
    assert described(Wind(simulate=True)) == "wind: simulated"
    assert described(Density(500)) == "density: strands 500"

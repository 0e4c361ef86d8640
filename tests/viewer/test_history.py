from neural_strands.editing.settings import Density, Haircut, Wind
from neural_strands.viewer.history import History

CUT, GROW = Haircut(length=0.1), Density(500)


def test_what_is_undone_can_be_done_again_in_order():
    both = History().with_edit(CUT).with_edit(GROW)
    assert both.done == (CUT, GROW)
    one, none = both.back(), both.back().back()
    assert (one.done, one.undone) == ((CUT,), (GROW,))
    assert (none.done, none.undone) == ((), (CUT, GROW))
    assert none.forward().forward() == both


def test_at_either_end_nothing_changes():
    assert History().back() == History().forward() == History()


def test_a_new_edit_forgets_what_was_undone():
    assert History((CUT,), (GROW,)).with_edit(CUT) == History((CUT, CUT))


def test_starting_over_can_be_taken_back():
    history = History((CUT,), (GROW,)).cleared()
    assert history.done == ()
    assert history.forward().done == (CUT,)


def test_of_winds_in_a_row_the_last_one_stays():
    calm, storm = Wind(strength=0.5), Wind(strength=3.0)
    assert History((CUT,)).with_edit(calm).with_edit(storm).done == (CUT, storm)
    assert History((calm,)).with_edit(CUT).with_edit(storm).done == (calm, CUT, storm)

"""The panel of a page: one tab for each thing to do, as far as the scene has something for it."""

from collections.abc import Callable

from neural_strands.viewer.look_panel import add_look_panel
from neural_strands.viewer.page import Page
from neural_strands.viewer.photographs_panel import add_photographs_panel


def add_panels(page: Page) -> Callable[[], None]:
    """Fill the panel, instead of whatever is in it.

    Returns:
        draws anew whatever depends on the page's strands.
    """
    gui, scene = page.server.gui, page.scene
    gui.reset()
    gui.set_panel_label("Neural Strands")
    gui.configure_theme(show_logo=False, show_share_button=False)
    gui.add_markdown(f"**{scene.path.name}** ({scene.kind})" + (f"\n\n{scene.note}" if scene.note else ""))
    tabs = gui.add_tab_group()
    with tabs.add_tab("Look"):
        redraw = add_look_panel(page)
    if scene.photographs is not None and len(scene.photographs):
        with tabs.add_tab("Photographs"):
            add_photographs_panel(page, scene.photographs)
    return redraw

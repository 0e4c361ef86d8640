import asyncio
import threading

from viser import _messages
from viser.infra._async_message_buffer import AsyncMessageBuffer

from neural_strands.viewer.waking import wake_in_loop


def test_a_message_that_comes_just_before_the_sender_waits_is_sent(monkeypatch):
    message = _messages.GuiUpdateMessage("list", {"content": "transfer"})

    async def sent():
        buffer = AsyncMessageBuffer(asyncio.get_running_loop(), persistent_messages=True)
        wake_in_loop(buffer)
        threads = []

        def interrupted():
            # asyncio's event calls this after it has found itself unset, and before it waits.
            if not threads:
                threads.append(threading.Thread(target=buffer.push, args=(message,)))
                threads[0].start()
                threads[0].join()
            return asyncio.get_running_loop()

        monkeypatch.setattr(buffer.message_event, "_get_loop", interrupted)
        windows = buffer.window_generator(0)
        try:
            return await asyncio.wait_for(anext(windows), 60)
        finally:
            await windows.aclose()

    assert asyncio.run(sent()) == [message]


def test_a_sender_that_waits_already_is_not_left_behind():
    message = _messages.GuiUpdateMessage("list", {"content": "transfer"})

    async def sent():
        buffer = AsyncMessageBuffer(asyncio.get_running_loop(), persistent_messages=True)
        windows = buffer.window_generator(0)
        waiting = asyncio.create_task(anext(windows))
        await asyncio.sleep(0.1)
        wake_in_loop(buffer)
        threading.Thread(target=buffer.push, args=(message,)).start()
        try:
            return await asyncio.wait_for(waiting, 10)
        finally:
            await windows.aclose()

    assert asyncio.run(sent()) == [message]

"""A headless Chromium that a test can click in and read from, over DevTools through a pipe."""

import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--allow-file-access-from-files", "--disable-dev-shm-usage",
    "--remote-debugging-pipe", "--window-size=1200,900",
)  # fmt: skip

PATIENCE_S = 60.0
"""A state that has not come by then will not come, on a machine that is as busy as may be."""
NAVIGATED = ("Inspected target navigated or closed", "Execution context was destroyed.")
ENDS_IN_S = 10.0
"""Time in which Chromium ends when it is told to, before it is killed."""


class Page:
    """One open page."""

    def __init__(self, write: int, read: int) -> None:
        self._write, self._read, self._buffer, self._next, self._session = write, read, b"", 0, None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.call("Page.enable")
        self.call("Runtime.enable")
        self.problems: list[str] = []

    def open(self, path: Path, fragment: str = "") -> None:
        """Open a file and wait until it is loaded."""
        self.call("Page.navigate", url=path.resolve().as_uri() + fragment)
        self.until("document.readyState === 'complete'")

    def value(self, expression: str) -> Any:
        """Value of a JavaScript expression."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, (expression, answer)
        return answer["result"].get("value")

    def text(self, selector: str) -> str:
        """Text of the first element that a CSS selector finds."""
        return self.value(f"document.querySelector({json.dumps(selector)}).textContent")

    def click(self, selector: str) -> None:
        """Click into the middle of an element with the mouse."""
        place = f"document.querySelector({json.dumps(selector)})"
        self.value(f"{place}.scrollIntoView({{block: 'center', inline: 'center', behavior: 'instant'}})")
        box = self.value(f"(b => [b.x, b.y, b.width, b.height])({place}.getBoundingClientRect())")
        x, y = box[0] + box[2] / 2, box[1] + box[3] / 2
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def until(self, expression: str) -> None:
        """Wait until an expression is true: what a test asserts of a page it awaits, for a page answers in its time."""
        end = time.monotonic() + PATIENCE_S
        while not self.is_true(expression):
            assert time.monotonic() < end, f"never true: {expression}"
            time.sleep(0.05)

    def until_text(self, selector: str, start: str) -> None:
        """Wait until the text of the first element that a CSS selector finds begins as said."""
        text = f"document.querySelector({json.dumps(selector)})?.textContent"
        self.until(f"({text} ?? '').startsWith({json.dumps(start)})")

    def until_is(self, expression: str, wanted: Any) -> None:
        """Wait until the value of an expression is the wanted one."""
        self.until(f"JSON.stringify({expression}) === JSON.stringify({json.dumps(wanted)})")

    def is_true(self, expression: str) -> bool:
        """Whether an expression is true now; it is not while the page goes to another address."""
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if answer.get("error", {}).get("message") in NAVIGATED:
            return False
        assert "error" not in answer, answer
        assert "exceptionDetails" not in answer["result"], (expression, answer)
        return bool(answer["result"]["result"].get("value"))

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Result of a DevTools command."""
        answer = self.ask(method, **params)
        assert "error" not in answer, (method, answer)
        return answer["result"]

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        """Answer to a DevTools command; events on the way are kept when they tell of an error in the page."""
        self._next += 1
        message = {"id": self._next, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("method") == "Runtime.exceptionThrown":
                self.problems.append(json.dumps(answer["params"]))
            if answer.get("id") == self._next:
                return answer

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            part = os.read(self._read, 1 << 16)
            assert part, "chromium has gone"
            self._buffer += part
        message, self._buffer = self._buffer.split(b"\0", 1)
        return json.loads(message)


@contextmanager
def browser() -> Iterator[Page]:
    """A page in a fresh Chromium; the test fails when none is installed."""
    program = next((found for name in NAMES if (found := shutil.which(name))), None)
    assert program, "this test needs Chromium: apt-get install chromium"
    to_read, to_write = os.pipe()
    from_read, from_write = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [program, *FLAGS, f"--user-data-dir={profile}"]
        script = f'exec "$@" 3<&{to_read} 4>&{from_write}'
        process = subprocess.Popen(
            ["bash", "-c", script, "chromium", *command], pass_fds=(to_read, from_write), stderr=subprocess.DEVNULL
        )
        os.close(to_read)
        os.close(from_write)
        try:
            yield Page(to_write, from_read)
        finally:
            process.terminate()
            try:
                process.wait(timeout=ENDS_IN_S)
            except subprocess.TimeoutExpired:  # seen once in some hundred, after all that was asserted
                process.kill()
                process.wait()
            os.close(to_write)
            os.close(from_read)

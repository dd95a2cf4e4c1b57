"""A screen that nobody sees, and a hand that points at it and reads what it then says."""

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from shutil import which
from typing import Any

import pytest

from mocap.rerun.viewer import quiet_environment, viewer_program


@contextmanager
def screen(size: tuple[int, int] = (1280, 900)) -> Iterator[str]:
    """The name of a virtual X display."""
    program = which("Xvfb")
    if program is None and not os.environ.get("CI"):
        pytest.skip("no virtual screen: apt-get install xvfb")
    read, write = os.pipe()
    command = [str(program), "-displayfd", str(write), "-screen", "0", f"{size[0]}x{size[1]}x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as answer:
            yield f":{answer.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


class Pointer:
    """A client of the viewer's own remote control (Model Context Protocol over standard input and output)."""

    def __init__(self, endpoint: str) -> None:
        """Connect to the viewer at ``http://...``."""
        self.process = subprocess.Popen(
            [viewer_program(), "viewer-mcp", "--endpoint", endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=quiet_environment(os.environ),
        )
        self.count = 0
        client = {"name": "tests", "version": "1"}
        self._call("initialize", {"protocolVersion": "2024-11-05", "capabilities": {}, "clientInfo": client})
        self._send({"jsonrpc": "2.0", "method": "notifications/initialized"})

    def __enter__(self) -> "Pointer":
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self.process.terminate()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            pipe.close()

    def hover(self, x: float, y: float) -> list[str]:
        """Move to a place of the window, and read all texts that are there then."""
        self.use("hover", pos={"x": x, "y": y})
        return self.texts()

    def texts(self) -> list[str]:
        """All that the window says, as an accessibility tool reads it."""
        answer = self.use("widget_tree")
        found: list[str] = []

        def walk(node: dict[str, Any]) -> None:
            found.extend(str(node[key]) for key in ("label", "value") if node.get(key))
            for child in node.get("children", []):
                walk(child)

        for node in json.loads(answer)["nodes"]:
            walk(node)
        return found

    def use(self, tool: str, **arguments: Any) -> str:
        """What a tool answers; fails if that is an error."""
        result = self._call("tools/call", {"name": tool, "arguments": arguments})["result"]
        assert not result.get("isError"), result
        return result["content"][0]["text"]

    def _call(self, method: str, params: dict[str, Any]) -> dict[str, Any]:
        self.count += 1
        self._send({"jsonrpc": "2.0", "id": self.count, "method": method, "params": params})
        assert self.process.stdout is not None
        while True:
            message = json.loads(self.process.stdout.readline())
            if message.get("id") == self.count:
                return message

    def _send(self, message: dict[str, Any]) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(message) + "\n")
        self.process.stdin.flush()

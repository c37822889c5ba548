"""A real browser for the views' tests: headless Chromium over its DevTools protocol."""

import asyncio
import base64
import contextlib
import json
import re
import shutil
import subprocess
import time
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path

from tornado.websocket import websocket_connect

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
_FLAGS = [
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--hide-scrollbars"),
    *("--remote-debugging-port=0", "--remote-allow-origins=*"),
]
_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")


@dataclass
class Visit:
    """What a visit to a page left behind."""

    picture: bytes = b""
    """PNG."""
    errors: list[str] = field(default_factory=list)
    """Console errors and uncaught exceptions."""
    answers: list = field(default_factory=list)
    """Values of the expressions asked for."""


def visit(
    url,
    profile: Path,
    width,
    height,
    *,
    ready="document.readyState === 'complete'",
    ask=(),
    patience=60.0,
    settle=0.3,
    scripts=True,
    media="",
    until=None,
    graphics=False,
):
    """Open `url` in a window of width x height, wait until `ready` holds and `settle` s more; return a Visit.

    `until`: takes the picture (PNG bytes) and says whether it shows what was waited for; else it is taken again.
    `graphics`: WebGL, drawn in software.
    """
    assert CHROMIUM, "no Chromium on this machine"
    flags = [*_FLAGS, *(_WEBGL if graphics else ("--disable-gpu",)), f"--user-data-dir={profile}"]
    process = subprocess.Popen(
        [CHROMIUM, *flags, f"--window-size={width},{height}", "about:blank"], stderr=subprocess.PIPE, text=True
    )
    try:
        port = next(match[1] for line in process.stderr if (match := re.search(r"ws://127\.0\.0\.1:(\d+)/", line)))
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as reply:
            page = next(target for target in json.load(reply) if target["type"] == "page")
        address = page["webSocketDebuggerUrl"]
        return asyncio.run(_drive(address, url, width, height, ready, ask, patience, settle, scripts, media, until))
    finally:
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(10)


async def _drive(socket, url, width, height, ready, ask, patience, settle, scripts, media, until):
    connection = await websocket_connect(socket, max_message_size=1 << 28)
    found, count = Visit(), 0

    async def call(method, **parameters):
        nonlocal count
        count += 1
        mine = count
        await connection.write_message(json.dumps({"id": mine, "method": method, "params": parameters}))
        while True:
            message = json.loads(await connection.read_message())
            if message.get("id") == mine:
                return message.get("result", {})
            _note(message, found)

    async def value(expression):
        reply = await call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        return reply.get("result", {}).get("value")

    for domain in ("Page", "Runtime", "Log"):
        await call(f"{domain}.enable")
    await call(
        "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
    )
    if media:
        await call("Emulation.setEmulatedMedia", media=media)
    if not scripts:
        await call("Emulation.setScriptExecutionDisabled", value=True)
    await call("Page.navigate", url=url)
    end = time.monotonic() + patience
    while scripts and not await value(ready):
        assert time.monotonic() < end, f"{url} was not ready after {patience} s: {found.errors}"
        await asyncio.sleep(0.1)
    await asyncio.sleep(settle)
    found.answers = [await value(expression) for expression in ask] if scripts else []
    while True:
        shot = await call("Page.captureScreenshot", format="png")
        found.picture = base64.b64decode(shot["data"])
        if until is None or until(found.picture):
            break
        assert time.monotonic() < end, f"{url} did not show what was waited for within {patience} s: {found.errors}"
        await asyncio.sleep(1.0)
    connection.close()
    return found


def _note(message, found):
    parameters = message.get("params", {})
    if message.get("method") == "Runtime.exceptionThrown":
        found.errors.append(str(parameters["exceptionDetails"].get("exception", {}).get("description", parameters)))
    if message.get("method") == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "assert"):
        found.errors.append(
            str([argument.get("value", argument.get("description")) for argument in parameters["args"]])
        )
    if message.get("method") == "Log.entryAdded" and parameters["entry"]["level"] == "error":
        found.errors.append(parameters["entry"]["text"])

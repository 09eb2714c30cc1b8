"""A headless Chromium for the tests of pages: runs a script in a page, which posts what it finds to the test."""

import json
import queue
import shutil
import subprocess
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless", "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-quic",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars",
    "--enable-logging=stderr", "--v=0",
)  # fmt: skip
WATCH = "<script>window.wrong = []; addEventListener('error', e => wrong.push(String(e.message)));</script>"
SAY = """<script>addEventListener('load', async () => {{
const drawings = n => new Promise(done => {{ const step = () => n-- ? requestAnimationFrame(step) : done(); step(); }});
const said = await (async () => {{ {script} }})().catch(e => ({{failed: String(e)}}));
await fetch('/said', {{method: 'POST', body: JSON.stringify({{...said, wrong}})}});
}});</script>"""
PATIENCE = 90.0  # [s]: graphics in software on a busy machine


class _Handler(SimpleHTTPRequestHandler):
    """Serves the scratch folder, and keeps what is posted."""

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(204)
        self.end_headers()
        self.server.said.put(json.loads(body))  # type: ignore[attr-defined]

    def log_message(self, format: str, *args: object) -> None:
        """Nothing on standard error."""


def browser() -> str:
    """Skips where there is none."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no Chromium on this machine: the pages' scripts are not run")
    return found


def ask(page: Path, script: str, scratch: Path, width: int = 1280) -> dict:
    """What `script` (the body of an async function; `await drawings(n)` waits) returns in the page, shown in a frame as
    wide as asked for: `wrong` are its errors, `console` what the browser complains about.
    """
    program = browser()
    body = page.read_text(encoding="utf-8").replace("<head>", "<head>" + WATCH, 1)
    body = body.replace("</body>", SAY.format(script=script) + "</body>")
    (scratch / "asked.html").write_text(body, encoding="utf-8")
    # headless windows are 500 px wide or wider: a phone's page lies in a frame
    frame = f'<iframe src="asked.html" style="border:0;width:{width}px;height:900px"></iframe>'
    head = '<!doctype html><link rel="icon" href="data:,"><body style="margin:0">'
    (scratch / "frame.html").write_text(head + frame, encoding="utf-8")
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, directory=str(scratch)))
    server.said = queue.Queue()  # type: ignore[attr-defined]
    serving = threading.Thread(target=server.serve_forever, daemon=True)
    serving.start()
    url = f"http://127.0.0.1:{server.server_port}/frame.html"
    words = [program, *FLAGS, f"--user-data-dir={scratch / 'profile'}", f"--window-size={max(width, 500)},900", url]
    log = scratch / "browser.log"
    with log.open("w") as errors, subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=errors) as running:
        try:
            said = server.said.get(timeout=PATIENCE)  # type: ignore[attr-defined]
        finally:
            running.terminate()
            server.shutdown()
            serving.join()
            server.server_close()
    console = [line for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if "CONSOLE" in line]
    return {**said, "console": console}

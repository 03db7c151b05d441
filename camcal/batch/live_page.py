"""The page of `camcal watch`: the effect of the last pictures, and where to hold the target; it reloads itself."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from camcal.batch.watch import Step
from camcal.errors import UsageError
from camcal.report import html
from camcal.report.charts.base import Chart
from camcal.report.charts.svg import svg
from camcal.system.text import counted

HOST = "127.0.0.1"
RELOAD = 1  #: s
SHOWN = 30  #: pictures in the table, the last ones


class LivePage:
    """A page served on the loopback interface.

    Parameters
    ----------
    port : int
        0 takes a free one.

    Raises
    ------
    UsageError
        If the port is taken.
    """

    def __init__(self, port: int):
        self.text = page([], None, None)
        owner = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                # another site's name that resolves to this address must not read the page
                host = (self.headers.get("Host") or "").rpartition(":")[0]
                if self.path != "/" or host not in (HOST, "localhost"):
                    self.send_error(404)
                    return
                data = owner.text.encode()
                self.send_response(200)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(data)))
                self.send_header("Cache-Control", "no-store")
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *args: Any) -> None:
                """Suppress messages on stderr."""

        try:
            self.server = ThreadingHTTPServer((HOST, port), Handler)
        except OSError as error:
            raise UsageError(
                f"the port {port} cannot be used: {(error.strerror or str(error)).lower()}.",
                "Choose another, or 0 for a free one.",
            ) from None
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{HOST}:{self.server.server_address[1]}/"

    def show(self, steps: Sequence[Step], chart: Chart | None, target: float | None) -> None:
        """Update the page."""
        self.text = page(steps, chart, target)

    def close(self) -> None:
        """Stop serving the page."""
        self.server.shutdown()
        self.server.server_close()


def page(steps: Sequence[Step], chart: Chart | None, target: float | None) -> str:
    """The page as HTML text."""
    style = Path(html.__file__).with_name("style.css").read_text(encoding="utf-8")
    last = steps[-1] if steps else None
    if last is None:
        head = "<p>Waiting for the first picture.</p>"
    else:
        now = f"{last.after:.3g} px" if last.after is not None else escape(last.trouble or "no camera yet")
        wanted = f" (wanted: {target:g} px)" if target is not None else ""
        weak = f", at the {escape(last.weakest)} of the picture" if last.weakest else ""
        head = (
            f"<p>Worst projection uncertainty: <strong>{now}</strong>{wanted}{weak}; "
            f"{counted(last.views, 'picture')}.</p>"
            f"<p>Next: {escape(last.advice)}.</p>"
        )
    drawn = "" if chart is None else f"<figure>{svg(chart, 'next')}</figure>"
    rows = "\n".join(map(_row, reversed(steps[-SHOWN:])))
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="refresh" content="{RELOAD}"><title>camcal watch</title><style>{style}\n'
        "main { max-width: 60rem; margin: auto; padding: 1rem }</style></head><body><main>"
        f"<h1>camcal watch</h1>{head}{drawn}<table><thead><tr><th>picture</th><th>points</th><th>rms, px</th>"
        f"<th>worst before, px</th><th>after</th><th></th></tr></thead><tbody>{rows}</tbody></table>"
        "</main></body></html>\n"
    )


def _row(step: Step) -> str:
    numbers = ["" if x is None else f"{x:.3g}" for x in (step.rms, step.before, step.after)]
    cells = [step.id, str(step.points), *numbers, step.reason or step.trouble]
    return "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"

"""Server of the page on which points of the model are picked in the first image, on localhost only.

The page shows the image with a magnifier and the model as a wireframe with numbered corners. A corner and its pixel
form a pair; with four or more pairs the pose is solved after each change and the model is drawn into the image. Save
writes `init.toml` and stops the server.
"""

import json
import secrets
import sys
import webbrowser
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from http.client import HTTPException
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uavbench.bench.said import say
from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.overlay import lines_in_image
from uavbench.tracker.images.track_images import frames, load_model
from uavbench.tracker.initialization import pose_from_points, read_init
from uavbench.tracker.protocol import Image
from uavbench.tracker.visible_edges import visible_edges
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.folders import try_place
from uavbench.trajectories.files.origin import refuse_foreign_file
from uavbench.trajectories.files.reading import json_value
from uavbench.trajectories.files.writing import new_file
from uavbench.trajectories.pose import Array

PAGE = Path(__file__).parent / "pick.html"
POINTS = "picked points"
FEWEST = 4
MOST_BYTES = 1 << 20
"""Largest request body of the page; a pair is about 60 bytes."""
SILENT_S = 20.0
NOT_HERE = b"not here: open the address that uavbench printed, on this computer"


@dataclass(frozen=True, eq=False)
class Picking:
    """A picking session: the first image, the structure, and the camera; its corners are the end points of edges."""

    image: Image
    camera: Camera
    structure: Structure
    out: Path

    @property
    def corners(self) -> Array:
        """Points (n, 3) of the model that can be picked, in m."""
        return self.structure.vertices[np.unique(self.structure.edges)]

    def page(self, token: str) -> str:
        """The page as one self-contained HTML file."""
        number = {vertex: k for k, vertex in enumerate(np.unique(self.structure.edges).tolist())}
        data = {
            "token": token,
            "width": self.camera.width,
            "height": self.camera.height,
            "corners": self.corners.tolist(),
            "edges": [[number[a], number[b]] for a, b in self.structure.edges.tolist()],
            "out": str(self.out),
        }
        text = PAGE.read_text(encoding="utf-8")
        return text.replace("DATA_OF_THE_PICKING", json.dumps(data).replace("<", "\\u003c"))

    def solve(self, pairs: Iterable[Any]) -> dict[str, Any]:
        """Edges of the model at the pose of the pairs, as polylines in px, and each pair's distance from its corner."""
        points, pixels = self._read(pairs)
        pose = pose_from_points(points, pixels, self.camera)
        edges = visible_edges(self.structure, self.camera, pose).segments_px
        lines = [line.round(2).tolist() for line in lines_in_image(edges, self.camera)]
        away = np.linalg.norm(self.camera.project(pose.transform(points)) - pixels, axis=1)
        return {"lines": lines, "residuals_px": away.tolist(), "rms_px": float(np.sqrt(np.mean(away**2)))}

    def save(self, pairs: Iterable[Any]) -> dict[str, Any]:
        """Write `init.toml`, completely or not at all; UserError for pairs that it could not be read with."""
        pairs = list(pairs)
        solved = self.solve(pairs)
        points, pixels = self._read(pairs)
        rows = [
            f"    {{ model_m = {point}, image_px = {[round(v, 3) for v in pixel]} }},\n"
            for point, pixel in zip(points.tolist(), pixels.tolist(), strict=True)
        ]
        with new_file(self.out, kind=POINTS) as new:
            new.write_text("points = [\n" + "".join(rows) + "]\n", encoding="utf-8", newline="\n")
            try:
                read_init(new, self.camera, self.structure)
            except UserError as error:
                raise UserError(str(error).removeprefix(f"{new}: ")) from None
        return {"saved": str(self.out), "rms_px": solved["rms_px"]}

    def _read(self, pairs: Iterable[Any]) -> tuple[Array, Array]:
        """Model points (n, 3) and pixels (n, 2) of pairs {corner, image_px}; UserError when they are invalid."""
        try:
            rows = [(int(p["corner"]), float(p["image_px"][0]), float(p["image_px"][1])) for p in pairs]
            points = self.corners[[k for k, _, _ in rows if k >= 0]]
        except (KeyError, IndexError, TypeError, ValueError, OverflowError):
            raise UserError("a pair consists of a corner of the model and a pixel of the image") from None
        pixels = np.array([[u, v] for _, u, v in rows]).reshape(-1, 2)
        if len(rows) < FEWEST or len(points) != len(rows) or not np.isfinite(pixels).all():
            raise UserError(f"{len(rows)} pairs; a pose takes at least {FEWEST}, better five")
        return points, pixels


def pick(source: Path, model: Path, camera: Path, out: Path, *, port: int, browser: bool) -> None:
    """Pick points on the first image of a folder or a video; UserError naming an invalid file."""
    refuse_foreign_file(out, POINTS)
    try_place(out)
    lens = Camera.load(camera)
    first = next(iter(frames(source, lens, 1.0)), None)
    if first is None:
        raise UserError(f"{source}: contains no image")
    picking = Picking(first[1], lens, load_model(model), out)

    def announce(address: str) -> None:
        say(f"open {address}", err=True)
        if browser:
            webbrowser.open(address)

    serve(picking, announce, port)
    say(out)


class PageServer(ThreadingHTTPServer):
    """A server that drops connections which end early or are no HTTP, without a message."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log the exception of a request, unless the other side is the reason."""
        if not isinstance(sys.exception(), OSError | HTTPException):
            super().handle_error(request, client_address)


def serve(picking: Picking, announce: Callable[[str], None], port: int = 0) -> None:
    """Serve the page on localhost until it is saved; announce(address) is called with its address.

    It listens on localhost only, and answers only requests with the token of its address.
    """
    token = secrets.token_urlsafe(16)
    done: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        timeout = SILENT_S  # stalled requests are dropped

        def do_GET(self) -> None:
            if not self.from_here():
                self.answer(403, "text/plain", NOT_HERE)
            elif self.path == f"/{token}":
                self.answer(200, "text/html; charset=utf-8", picking.page(token).encode())
            elif self.path == f"/{token}/image.png":
                self.answer(200, "image/png", cv2.imencode(".png", picking.image)[1].tobytes())
            else:
                self.answer(404, "text/plain", b"not here: open the address that uavbench printed")

        def do_POST(self) -> None:
            actions = {f"/{token}/solve": picking.solve, f"/{token}/save": picking.save}
            told_size = self.headers.get("Content-Length", "")
            size = int(told_size) if told_size.isascii() and told_size.isdigit() and len(told_size) < 10 else -1
            if not self.from_here():
                self.answer(403, "text/plain", NOT_HERE)
            elif self.path not in actions:
                self.answer(404, "text/plain", b"not here")
            elif not 0 <= size <= MOST_BYTES:
                self.answer(413 if size > 0 else 411, "text/plain", f"a body has at most {MOST_BYTES} bytes".encode())
            else:
                self.tell(actions[self.path], size)

        def tell(self, verb: Callable[[Iterable[Any]], dict[str, Any]], size: int) -> None:
            """Apply a method to the pairs in the request body, and answer with its result."""
            try:
                body = self.rfile.read(size)
            except OSError:  # the body is shorter than its Content-Length
                self.close_connection = True
                return
            if len(body) < size:
                self.answer(400, "text/plain", b"the body ends before its length")
                return
            try:
                pairs = json_value(body)
                reply = verb(pairs if isinstance(pairs, list) else [])
            except (UserError, ValueError, OSError) as error:
                reply = {"error": str(error)}
            try:
                self.answer(200, "application/json", json.dumps(reply).encode())
            finally:  # even if the page was closed before its answer
                done.extend([reply["saved"]] if "saved" in reply else [])

        def from_here(self) -> bool:
            """Whether a request is from the page itself, by Host and Origin: guards against DNS rebinding and CSRF."""
            own = {f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost")}  # type: ignore[attr-defined]
            origin = self.headers.get("Origin")
            return self.headers.get("Host") in own and (origin is None or origin in {f"http://{name}" for name in own})

        def answer(self, status: int, kind: str, body: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: Any) -> None:
            """Log no request."""

    try:
        server = PageServer(("127.0.0.1", port), Handler)
    except OSError as error:
        raise UserError(f"port {port} cannot be used: {error.strerror}; choose another with --port") from None
    with server:
        server.timeout = 0.2
        announce(f"http://127.0.0.1:{server.server_port}/{token}")
        while not done:
            server.handle_request()

"""The picking page in headless Chromium: corners chosen and clicked, the pose solved, the file saved."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from tests.bench.test_pick import post, served
from tests.reports.browser import browser
from uavbench.bench.pick.server import Picking
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.initialization import read_init


def click_at(page, x, y):
    for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)


def on_screen(page, canvas, expression):
    """Place on the screen of a point [x, y] in a canvas's own pixels."""
    return page.value(
        f"(([x, y], c, b) => [b.left + x / c.width * b.width, b.top + y / c.height * b.height])"
        f"({expression}, {canvas}, {canvas}.getBoundingClientRect())"
    )


@pytest.mark.slow
def test_five_clicks_make_a_first_pose(tmp_path):
    sequence = Sequence.load(TRIAL)
    picking = Picking(sequence.image(0), sequence.camera, sequence.structure, tmp_path / "init.toml")
    pose = sequence.true_cam_from_world(0)
    pixels = sequence.camera.project(pose.transform(picking.corners))
    with served(picking) as address, browser() as page:
        page.call("Page.navigate", url=address)
        page.until(
            "document.readyState === 'complete' && photo.complete && document.querySelector('#told').textContent"
        )
        for count, corner in enumerate((1, 3, 5, 7, 6), start=1):
            click_at(page, *on_screen(page, "model", f"placed(data.corners[{corner}])"))
            page.until_text("#told", f"Corner {corner + 1} is chosen")
            click_at(page, *on_screen(page, "image", f"toCanvas({pixels[corner].tolist()})"))
            page.until_is("pairs.length", count)
        page.until("solved && solved.rms_px < 0.5")
        before = page.value("pairs[4].image_px[0]")
        page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight")
        page.until(f"Math.abs(pairs[4].image_px[0] - {before + 0.25}) < 1e-6")
        page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft")
        page.until("solved && !document.querySelector('#save').disabled")
        page.click("#save")
        page.until_text("#told", "Saved")
        assert page.problems == []
    difference = (read_init(picking.out, sequence.camera) @ pose.inverse()).log()
    assert np.linalg.norm(difference[:3]) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1, 2])
def test_the_corners_of_the_image_on_the_screen_are_those_of_its_pixels(tmp_path, ratio):
    """As of an image that is larger than the page, where a border of 1 px is several pixels wide."""
    sequence = Sequence.load(TRIAL)
    camera = replace(sequence.camera, width=4000, height=3000)
    white = np.full((camera.height, camera.width, 3), 255, dtype=np.uint8)
    picking = Picking(white, camera, sequence.structure, tmp_path / "init.toml")
    with served(picking) as address, browser() as page:
        page.call("Emulation.setDeviceMetricsOverride", width=1200, height=900, deviceScaleFactor=ratio, mobile=False)
        page.call("Page.navigate", url=address)
        page.until("document.readyState === 'complete' && photo.complete")
        page.until("document.querySelector('#told').textContent")
        border = page.value("['Left', 'Top', 'Right', 'Bottom'].map(s => getComputedStyle(image)[`border${s}Width`])")
        left, top, right, bottom = (float(width.removesuffix("px")) for width in border)
        corners = page.value(
            f"(b => [place({{clientX: b.left + {left}, clientY: b.top + {top}}}), "
            f"place({{clientX: b.right - {right}, clientY: b.bottom - {bottom}}})])(image.getBoundingClientRect())"
        )
        pixels = sequence.camera.project(sequence.true_cam_from_world(0).transform(picking.corners))
        pairs = [{"corner": k, "image_px": pixels[k].tolist()} for k in range(5)]
        post(address, "save", pairs)  # the server ends with it
    assert np.abs(np.array(corners) - [[-0.5, -0.5], [3999.5, 2999.5]]).max() < 0.01


class Slow(Picking):
    """Solves when it is told to."""

    may_solve = threading.Event()

    def solve(self, pairs):
        assert self.may_solve.wait(60)
        return super().solve(pairs)


@pytest.mark.slow
def test_an_answer_that_comes_late_leaves_what_was_told_since(tmp_path):
    sequence = Sequence.load(TRIAL)
    picking = Slow(sequence.image(0), sequence.camera, sequence.structure, tmp_path / "init.toml")
    pixels = sequence.camera.project(sequence.true_cam_from_world(0).transform(picking.corners))
    with served(picking) as address, browser() as page:
        page.call("Page.navigate", url=address)
        page.until("document.readyState === 'complete' && photo.complete")
        for count, corner in enumerate((1, 3, 5, 7, 6), start=1):
            click_at(page, *on_screen(page, "model", f"placed(data.corners[{corner}])"))
            page.until_text("#told", f"Corner {corner + 1} is chosen")
            if count <= 4:
                click_at(page, *on_screen(page, "image", f"toCanvas({pixels[corner].tolist()})"))
                page.until_is("pairs.length", count)
        picking.may_solve.set()
        page.until("solved && solved.rms_px < 0.5")
        page.until_text("#told", "Corner 7 is chosen")
        page.click("#save")  # the server ends with it
        page.until_text("#told", "Saved")

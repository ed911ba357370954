"""Diagnoses to show, and a real browser to show them in."""

import json
import re
import subprocess
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import independent
from few_effects import few_entries
from snapshot_texts import snapshot as snapshot
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnoser


CHROMIUM = "/usr/bin/chromium"
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PROBE = """<script>window.addEventListener("load", () => {
  const boxes = [...document.querySelectorAll("figure svg")].map(svg => svg.getBoundingClientRect());
  const uses = [...document.querySelectorAll("svg use")];
  const ids = [...document.querySelectorAll("[id]")].map(node => node.id);
  document.title = JSON.stringify({
    figures: boxes.length, drawn: boxes.filter(box => box.width > 200 && box.height > 100).length,
    paths: document.querySelectorAll("svg path").length,
    dangling: uses.filter(use => !document.getElementById(
      (use.getAttribute("xlink:href") || use.getAttribute("href")).slice(1))).length,
    broken: [...document.querySelectorAll("nav a")].filter(a => !document.querySelector(a.getAttribute("href"))).length,
    twice: ids.length - new Set(ids).size, wide: document.documentElement.scrollWidth - window.innerWidth,
    resources: performance.getEntriesByType("resource").length,
  })});</script>"""


class Browser:
    """Chromium, headless, with a profile of its own."""

    def __init__(self, folder: Path):
        self.folder = folder

    def __call__(self, *arguments: str) -> str:
        done = subprocess.run(
            [CHROMIUM, *FLAGS, f"--user-data-dir={self.folder / 'profile'}", *arguments],
            capture_output=True,
            text=True,
            timeout=600,
            check=True,
        )
        return done.stdout

    def whole(self, page: Path, figures: int, width: int = 1000) -> str:
        """The document of a page with so many figures, each drawn; no link or id is wrong, nothing runs out of the window, and
        one file has all of it. A script that is added writes the counts into the title."""
        copy = self.folder / "page.html"
        copy.write_text(page.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>"), encoding="utf-8")
        window = f"--window-size={width},800"
        document = self(window, "--virtual-time-budget=5000", "--dump-dom", copy.as_uri())
        title = re.search(r"<title>(.*?)</title>", document, re.S)
        assert title is not None
        seen = json.loads(title[1])
        assert seen["figures"] == seen["drawn"] == figures and (seen["paths"] > 100 or not figures), seen
        assert seen["dangling"] == seen["twice"] == seen["broken"] == seen["resources"] == 0 and seen["wide"] <= 0, seen
        return document

    def title(self, page: Path, *flags: str) -> str:
        """The title that a page's script has given it."""
        document = self(*flags, "--virtual-time-budget=5000", "--dump-dom", page.as_uri())
        return unescape(re.findall(r"<title>(.*?)</title>", document, re.S)[0])

    def printed(self, page: Path) -> int:
        """How many sheets of A4 a page fills."""
        copy, pdf = self.folder / "a4.html", self.folder / "a4.pdf"
        copy.write_text(page.read_text(encoding="utf-8").replace("@page {", "@page { size: A4;"), encoding="utf-8")
        self(f"--print-to-pdf={pdf}", "--no-pdf-header-footer", copy.as_uri())
        return len(re.findall(rb"/Type\s*/Page\b", pdf.read_bytes()))


@pytest.fixture
def chromium(tmp_path) -> Browser:
    if not Path(CHROMIUM).exists():
        pytest.skip(f"no browser at {CHROMIUM}: install chromium")
    return Browser(tmp_path)


SIGMA = 1e-4


def instrument(seed: int, alpha_deg, beta_deg, *, product: float = 0.0, knock: int | None = None) -> PositionSet:
    """Readings (plain numpy) with noise of 0.1 mg, a product term on y (g/g^2), and one position knocked."""
    rng = np.random.default_rng(seed)
    alpha, beta = np.radians(alpha_deg), np.radians(beta_deg)
    levels, pitch = np.unique(beta, return_inverse=True)
    small = [rng.normal(0, 1e-3, 3) for _ in range(4)]
    readings = independent.readings(
        alpha, beta, independent.Instrument(*small, rng.uniform(-2e-3, 2e-3, len(levels))[pitch])
    )
    readings[:, 1] += product * readings[:, 1] * readings[:, 2]
    readings += SIGMA * rng.normal(size=readings.shape)
    if knock is not None:
        readings[knock] += [9e-4, -8e-4, 9e-4]
    names = tuple(f"p{k + 1}" for k in range(len(alpha)))
    sd = np.full(readings.shape, SIGMA)
    return PositionSet(names, np.asarray(alpha_deg), np.asarray(beta_deg), readings, sd=sd, source="bench/head.csv")


def head() -> tuple[np.ndarray, np.ndarray]:
    """The paper's plan, degrees."""
    return np.tile(np.arange(8) * 45.0, 3), np.repeat([0.0, 45.0, 90.0], 8)


@pytest.fixture(scope="session")
def diagnoser():
    return Diagnoser()


@pytest.fixture(scope="session")
def diagnosis(diagnoser):
    """A product term on y and a knocked position, both found."""
    return diagnoser(instrument(1, *head(), product=8e-4, knock=20))


@pytest.fixture(scope="session")
def adequate(diagnoser):
    return diagnoser(instrument(2, *head()))


@pytest.fixture(scope="session")
def mixed_up(diagnoser):
    """All readings in m/s^2, under columns that say g."""
    data = instrument(3, *head())
    return diagnoser(PositionSet(data.names, data.alpha_deg, data.beta_deg, data.readings * 9.80665, sd=data.sd))


@pytest.fixture(scope="session")
def by_hand():
    """Every position at a pitch angle of its own, as of a triad held by hand; few effects, as no other test has the plan."""
    diagnoser = Diagnoser(few_entries())
    rng = np.random.default_rng(4)
    return diagnoser(instrument(4, rng.uniform(0, 360, 24).round(1), np.linspace(-80, 85, 24).round(1)))


@pytest.fixture(scope="session")
def drifting():
    """The bias of x drifts by 5 mg an hour; few effects, as no other test has these columns."""
    diagnoser = Diagnoser(few_entries())
    data, time = instrument(5, *head()), 60.0 * np.arange(24)
    readings = data.readings + np.outer(time / 3600 * 5e-3, [1.0, 0.0, 0.0])
    return diagnoser(replace(data, readings=readings, time_s=time))

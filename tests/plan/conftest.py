"""A head with two mountings, and its responses."""

import tomllib
from pathlib import Path

import pytest

from tumblecal.chain.rig_file import rig_of
from tumblecal.plan.cells import cells_of
from tumblecal.plan.responses import responses_of


HEAD = """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 90, count = 4 }
beta_deg = [0, 45, 90]
mounts = ["A", "B"]
[chain.leaves]
dbeta = { by = "mount.pitch" }
dtheta = { by = "mount" }
[mounts]
A = { rotation_deg = [0, 0, 0] }
B = { rotation_deg = [0, 0, 90] }
[noise]
sd = "0.15 mg"
[priors]
dbeta = "3 arcmin"
[head]
alpha_deg = { start = 0, step = 45, count = 8 }
beta_deg = [-90, -45, 0, 45, 90]
times = { remount_s = 600 }
repeatability = { pitch = "20 arcsec", mount = "1 mrad" }
"""


@pytest.fixture(scope="session")
def head():
    return rig_of(tomllib.loads(HEAD), Path("rig.toml"))


@pytest.fixture(scope="session")
def candidates(head):
    return responses_of(head, cells_of(head.ability))

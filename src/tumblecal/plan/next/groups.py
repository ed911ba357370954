"""Groups of positions that are not measured yet: those of the data (a pitch setting, a mounting), and new ones.

A parameter of a new group (dbeta of a new pitch setting) has additional columns: its derivative is that of the group that the
position is evaluated with.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Parameter, Where, settings
from tumblecal.chain.where import VISITS
from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.full_model import FullModel
from tumblecal.ground.frames import rotation_matrix
from tumblecal.plan.next.proposals import NextPosition


# Pitch angles closer than this are one setting.
_SAME_ANGLE_DEG = 1e-4
# The index of a parameter with a value for each mounting, if the data have one mounting.
_BY_MOUNTING = {None: "mount", "pitch": "mount.pitch", "run.pitch": "run.mount.pitch"}


def joined_settings(problem: Problem, spots: Sequence[NextPosition]) -> tuple[Where, Int[np.ndarray, " spots"]]:
    """The settings of the data followed by new positions of the last run and clock, in the last or a new mounting; and for each
    new position the one of the last run and mounting with the nearest pitch setting. Groups are numbered as they first appear:
    those of the data come first."""
    data, where, more = problem.measured_data, problem.where, len(spots)
    pitch, place = np.asarray(where.index("pitch")), np.asarray(where.index("run.mount"))
    beta = np.array([spot.beta_deg for spot in spots])
    distance = np.abs(np.degrees(where.pitch_angle) - beta[:, None])
    another = pitch.max() + 1 + np.unique(beta, return_inverse=True)[1]
    new_pitch = np.where(distance.min(axis=1) < _SAME_ANGLE_DEG, pitch[np.argmin(distance, axis=1)], another)
    run, mount, clock = map(data.labels, ("run", "mount", "clock"))
    joined = settings(
        np.zeros(len(data) + more),
        np.zeros(len(data) + more),
        pitch=np.append(pitch, new_pitch),
        run=(*run, *(run[-1:] * more)),
        mount=(*mount, *(spot.mount or mount[-1] for spot in spots)),
        clock=(*clock, *(clock[-1:] * more)),
    )
    last = np.flatnonzero(place == place[-1])
    return joined, last[np.argmin(distance[:, last], axis=1)]


def leaves_of(model: FullModel) -> Iterator[tuple[Parameter, Int[np.ndarray, "groups components"]]]:
    """The free leaves of the nominal chain with their columns."""
    offset = 0
    for leaf in model.nominal_chain.free:
        yield leaf, offset + np.arange(leaf.value.size).reshape(leaf.value.shape)
        offset += leaf.value.size


def group_columns(
    diagnosis: Diagnosis, spots: Sequence[NextPosition], joined: Where, jacobian: Float[np.ndarray, "spots 3 full"]
) -> tuple[Float[np.ndarray, "spots 3 own"], Float[np.ndarray, " own"]]:
    """Columns of the parameters of new groups, removed from the columns that they were evaluated with.

    **Returns:** the columns, and the information that a prior on the whole leaf gives on each.
    """
    model, added, prior = diagnosis.model, [np.zeros((len(spots), 3, 0))], list[float]()
    root = diagnosis.problem.prior_root * model.scales[: model.nominal]
    stated, information = np.flatnonzero(np.any(root != 0, axis=0)), np.zeros(model.nominal)
    information[stated] = 1.0 / np.diag(np.linalg.inv(root[:, stated].T @ root[:, stated]))
    for leaf, columns in leaves_of(model):
        by, values = leaf.by, jacobian[:, :, columns].sum(axis=2)
        # The pitch settings of a new mounting are new by default; a rig file states the index of dbeta.
        if leaf.name == "dtheta" or (leaf.name == "dbeta" and not diagnosis.from_rig):
            by = _BY_MOUNTING.get(by, by)
        if by is None:
            continue
        # Positions that set the same setting again have one new visit.
        old, number = np.split(np.asarray(joined.index(VISITS.get(by, (by,))[0])), [-len(spots)])
        new = np.flatnonzero((number > old.max()) | (by in VISITS))
        for k, spot in enumerate(spots):
            if leaf.name == "dtheta" and spot.mount:
                # The angles of the mounting are singular: at 90 degrees about y two of them turn about the same axis. The
                # response to its small rotations is that to rotations of the head before the spindle.
                spindle = rotation_matrix(np.radians([spot.alpha_deg, 0.0, 0.0]))
                values[k] = jacobian[k][:, model.probe] @ spindle.T
        groups, own = np.unique(number[new], return_inverse=True)
        block = np.zeros((len(spots), 3, len(groups), columns.shape[1]))
        block[new, :, own] = values[new]
        added.append(block.reshape(len(spots), 3, -1))
        given = information[columns]
        same = np.where(np.ptp(given, axis=0) <= 1e-6 * given[0], given[0], 0.0)
        prior += np.tile(same, len(groups)).tolist()
        jacobian[np.ix_(new, np.arange(3), columns.ravel())] = 0.0
    return np.concatenate(added, axis=2), np.array(prior)

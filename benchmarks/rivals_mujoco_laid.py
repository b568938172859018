"""MuJoCo's cable drawn slowly over bodies with friction, and let come to rest: a worker of `bench rivals`.

A setting: time step [s], damping [1/s] and armature as in `rivals_mujoco`, pace [m/s] of the faster end, and how long
it rests before and after [s]. Cones are elliptic, contacts as hard as the time step lets them be.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from time import thread_time
from typing import Any

import mujoco
import numpy as np
from rivals_common import Rod
from rivals_mujoco import ALONG_X, Cable, model_of, wxyz
from scipy.spatial.transform import Rotation, Slerp

CONTACT = ' cone="elliptic" impratio="10">'
SURFACE = 'contype="{cable}" conaffinity="{body}" condim="3" friction="{mu} 0 0" solref="{twice} 1" solimp="{solimp}"'
SOLIMP = "0.99 0.999 0.0005"
TURN = 0.05  # m: as far as a quaternion that changes by 1 counts on the way of an end
DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


def words(values: Any) -> str:
    """Numbers for the model."""
    return " ".join(f"{x:.17g}" for x in values)


def drawn(rod: Rod, scene: Mapping[str, Any], joints: int, setting: Mapping[str, float]) -> dict[str, Any] | None:
    """Places of the joints at last, and the time of the steps [s]; None: it diverged."""
    dt = setting["step"]
    common = {"mu": scene["friction"], "twice": 2.0 * dt, "solimp": SOLIMP}
    bodies = "".join(
        f'<geom type="{body["type"]}" size="{words(body["size"])}" pos="{words(body["position"])}" '
        f'quat="{words(wxyz(Rotation.from_quat(body["quaternion"])))}" {SURFACE.format(cable=0, body=1, **common)}/>'
        for body in scene["bodies"]
    )
    model = model_of(rod, joints, setting, bodies, CONTACT, SURFACE.format(cable=1, body=0, **common))
    cable = Cable(model, rod, joints, setting["damping"])
    half = np.array((0.0, 0.0, 0.5 * rod.length / joints))
    starts, ends = (np.array(scene[side]) for side in ("starts", "ends"))
    far, turned = (np.linalg.norm(np.diff(part, axis=0), axis=1) for part in (ends[:, :3], ends[:, 3:]))
    way = np.concatenate(((0.0,), np.cumsum(far + TURN * turned)))
    at = np.minimum(np.arange(1, int(way[-1] / setting["pace"] / dt) + 2) * dt * setting["pace"], way[-1])
    hands = []
    for name, path in (("hand", starts), ("grip", ends)):  # the first and the last link begin half before an end
        turns = Slerp(way, Rotation.from_quat(path[:, 3:]))(at)
        places = np.stack([np.interp(at, way, x) for x in path[:, :3].T], axis=1) - turns.apply(half)
        hands.append((model.body(name).mocapid[0], places, wxyz(turns * ALONG_X)))
    rest = round(setting["rest"] / dt)
    began = thread_time()
    cable.step(rest)
    for k in range(len(at)):
        for hand, places, turns in hands:
            cable.data.mocap_pos[hand], cable.data.mocap_quat[hand] = places[k], turns[k]
        cable.step(1)
    cable.step(rest)
    spent = thread_time() - began
    places = cable.joints()
    bad = sum(int(cable.data.warning[kind].number) for kind in DIVERGED)
    return {"places": places.tolist(), "seconds": spent} if np.isfinite(places).all() and not bad else None


if __name__ == "__main__":
    request = json.load(sys.stdin)
    answers = [
        drawn(Rod.of(scene), scene, job["joints"], job["setting"])
        for job in request["jobs"]
        for scene in (request["scenes"][job["problem"]],)
    ]
    json.dump({"version": mujoco.__version__, "answers": answers}, sys.stdout)

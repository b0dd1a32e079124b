"""Finished members of a batch in a folder, one file each, named by the hash of its job.

A file holds a digest of everything in it; one that is damaged, altered or of another job counts as absent. Failures
that recur (a `ModelError`) are stored with their message, others (a lost worker) are not.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
import zipfile
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model import errors
from model.batch.job import Member
from model.errors import InputError, ModelError
from model.files.atomic_write import whole_file
from model.scene.build import Scene
from model.simulation.compliant_joints import CompliantJointMotion
from model.simulation.solution import EnergyAudit, Solution
from model.simulation.string_motion import StringMotion

_ARRAYS = ("time_s", "angle_rad", "speed_rad_per_s", "contact_normal_n", "contact_friction_n")
_GIVE = ("way_m", "speed_m_per_s", "force_n")
_FACTS = ("bodies", "contacts", "counters", "tolerance", "error_rad", "energy")
Array = NDArray[Any]


def _digest(about: dict[str, Any], arrays: dict[str, Array]) -> str:
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"\0{name} {array.dtype.str} {array.shape}\0".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


class Store:
    """A folder of finished members; made if it does not exist.

    Raises
    ------
    InputError : the folder cannot be made or written
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder):
                pass
        except OSError as problem:
            raise InputError(f"{self.folder}: cannot be written ({problem.strerror}); choose another store") from None

    def path(self, sha256: str) -> Path:
        """File of a job's hash."""
        return self.folder / f"{sha256}.npz"

    def get(self, sha256: str) -> tuple[dict[str, Any], dict[str, Array]] | None:
        """Facts and arrays kept under a hash; None where there is none, or the file is cut, damaged or altered."""
        try:
            with open(self.path(sha256), "rb") as raw, np.load(raw, allow_pickle=False) as file:
                about: dict[str, Any] = json.loads(str(file["about"]))
                arrays = {name: file[name] for name in file.files if name != "about"}
            if about.pop("content_sha256") != _digest(about, arrays) or about["sha256"] != sha256:
                return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile, zlib.error):
            return None
        return about, arrays

    def put(self, sha256: str, about: dict[str, Any], arrays: dict[str, Any]) -> None:
        """Write facts and arrays to the file of a hash, whole, in place of one that is there; `InputError` where the
        disk refuses.

        Raises
        ------
        InputError : the disk is full or gone
        """
        about = json.loads(json.dumps(about | {"sha256": sha256}))  # digest of what reading gives back
        about["content_sha256"] = _digest(about, arrays)
        with whole_file(self.path(sha256), "free space, then go on") as part, open(part, "wb") as file:
            np.savez(file, **arrays | {"about": np.array(json.dumps(about))})  # type: ignore[arg-type]

    def read(self, sha256: str, trial: str, parameters: str, scene: Scene | None = None) -> Member | None:
        """The member (a solution or an error) kept under a hash, with labels and ``scene`` of its job here; None where
        there is none."""
        kept = self.get(sha256)
        if kept is None:
            return None
        about, arrays = kept
        try:
            if "error" in about:
                kind, message = about["error"]
                return Member(trial, parameters, sha256, error=getattr(errors, kind)(message), reused=True)
            about["energy"] = about["energy"] and EnergyAudit(**about["energy"])
            about |= {name: tuple(about[name]) for name in ("bodies", "contacts")}
            found = {name: about[name] for name in _FACTS}
            if "directions" in about:
                found["give"] = CompliantJointMotion(tuple(about["directions"]), *(arrays.pop(name) for name in _GIVE))
            if scene is not None and "string_rows" in arrays:
                found["string"] = StringMotion(scene, arrays["time_s"], arrays.pop("string_rows"))
            solution = Solution(**found, **arrays)  # type: ignore[arg-type]
        except (KeyError, TypeError, AttributeError):
            return None
        return Member(trial, parameters, sha256, solution, reused=True)

    def write(self, member: Member) -> None:
        """Write a member to the file of its hash; nothing is written for one without a hash, or whose error is no
        `ModelError` (it need not recur).

        Raises
        ------
        InputError : the disk is full or gone
        """
        if not member.sha256 or (member.error is not None and not isinstance(member.error, ModelError)):
            return
        if member.solution is None:
            self.put(member.sha256, {"error": [type(member.error).__name__, str(member.error)]}, {})
            return
        s = member.solution
        about = {name: getattr(s, name) for name in _FACTS} | {"energy": s.energy and asdict(s.energy)}
        arrays = {name: getattr(s, name) for name in _ARRAYS if getattr(s, name) is not None}
        if s.give is not None:
            about["directions"] = s.give.directions
            arrays |= {name: getattr(s.give, name) for name in _GIVE}
        if s.string is not None:
            arrays["string_rows"] = s.string.rows
        self.put(member.sha256, about, arrays)

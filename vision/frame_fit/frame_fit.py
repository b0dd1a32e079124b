"""Arrays of all bodies of a film, and the Python interface of the compiled frame fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.bodies.occlusion import Occlusion
from vision.film.mmap_window import WINDOW_BYTES
from vision.film.source import FrameSource, Repeats
from vision.fitting.assessment import N_LEVELS, Assessed, Ratios, template_blocks
from vision.fitting.base import NO_REGION, Fit
from vision.fitting.frame_spline import Box, FilteredPart
from vision.fitting.icgn import FirstFit, FitMemory, fit_settings
from vision.fitting.illumination import IlluminationField, Squares
from vision.fitting.kernels import Region, ResidualSums, RigidFit
from vision.fitting.template import Template
from vision.frame_fit.compiled import (
    Bodies,
    Film,
    FitOutputs,
    Rows,
    States,
    Stop,
    fit_remaining_bodies,
    track_rows,
)
from vision.frame_fit.judgement import Standards
from vision.frame_fit.motion import Motion, expect_bodies

ALIGNED = 16  # pixels of a body begin at a multiple of so many


class FrameFit:
    """Fits the bodies of a film, of which ``templates`` and ``parents`` are in one order, ``order`` parents first."""

    def __init__(
        self,
        templates: Sequence[Template],
        occlusion: Occlusion,
        order: Sequence[int],
        parents: Sequence[int | None],
    ) -> None:
        self.templates, self._settings = templates, fit_settings()
        self._order = list(order)
        self.stop = Stop(*(np.zeros(n, dtype=np.int64) for n in (2, 4, 4, 1, 1)))
        count = [template.n_pixels for template in templates]
        padded = [-(-n // ALIGNED) * ALIGNED for n in count]
        self._start, n = [sum(padded[:i]) for i in range(len(count))], sum(padded)
        motion, standards = Motion.from_templates(templates, parents), Standards.from_templates(templates)
        self.states = _empty_states(motion, standards, n, occlusion.distances[0].size)
        self.found = _empty_found(len(count))
        self._bodies = self._pack_bodies(occlusion, n)

    def _pack_bodies(self, occlusion: Occlusion, n: int) -> Bodies:
        """Templates, squares and outlines of all bodies in one array each, for the compiled fit; ``n`` is the number of
        pixels."""
        templates, m = self.templates, len(self.templates)
        offset, columns = np.zeros(2 * n, dtype=np.float32), np.zeros(4 * n, dtype=np.float32)
        for start, template in zip(self._start, templates, strict=True):
            end = start + template.n_pixels
            offset[2 * start : 2 * end] = template.offset_px.reshape(-1)
            columns[4 * start : 4 * end] = template.columns.reshape(-1)
        pixel, grey = np.zeros(n, dtype=np.int32), np.zeros(n)
        squares = [template.get_or_make(IlluminationField).squares for template in templates]
        for start, one in zip(self._start, squares, strict=True):
            pixel[start : start + one.pixel.size], grey[start : start + one.pixel.size] = one.pixel, one.grey
        in_front = np.zeros((m, m), dtype=np.uint8)
        for i, others in enumerate(occlusion.in_front):
            in_front[i, others] = 1
        around = [group.reshape(-1) for group in occlusion.groups]
        blocks = [template.get_or_make(template_blocks) for template in templates]
        return Bodies(
            order=np.array(self._order, dtype=np.int64),
            start=np.array(self._start, dtype=np.int64),
            n_pixels=np.array([template.n_pixels for template in templates], dtype=np.int64),
            offset=offset,
            columns=columns,
            radius=np.array([template.radius_px for template in templates], dtype=float),
            box=np.array([template.box_px for template in templates], dtype=float),
            noise_normal=np.stack([template.noise_normal for template in templates]),
            averaged=np.array([template.n_averaged for template in templates], dtype=float),
            runs=_starts_and_counts([one.groups.shape[1] for one in blocks], 1),
            first=np.concatenate([one.first for one in blocks]).astype(np.int64),
            groups=np.concatenate([one.groups.reshape(-1) for one in blocks]),
            freedom=np.stack([one.freedom for one in blocks]),
            squares=Squares(
                pixel, grey, np.concatenate([s.first for s in squares]), np.concatenate([s.middle for s in squares])
            ),
            square_runs=_starts_and_counts([one.middle.size for one in squares], 1),
            in_front=in_front,
            arounds=_starts_and_counts([part.size for part in around], 3),
            around=np.concatenate(around),
            distance=occlusion.distances,
        )

    def memory(self, body: int) -> FitMemory:
        """The part of the arrays in which the fitter of a body works."""
        states, start, n = self.states, self._start[body], self.templates[body].n_pixels
        end = start + n
        work = states.work[5 * start : 5 * end].reshape(5, n)
        one = slice(body, body + 1)
        return FitMemory(states.weight[start:end], work, states.at[start:end], states.scale[one], states.apart[one])

    def expect(self, ordinal: int) -> Box | None:
        """Find where all bodies are expected in the ``ordinal``-th tracked frame; return the rectangle (y0, y1, x0, x1)
        that holds them, None where none is inside."""
        box = self.stop.expected
        size: tuple[int, int] = self._bodies.distance.shape[1:]
        found = self.found
        is_inside = expect_bodies(
            self.states.motion, ordinal, self._bodies.box, size, found.expected, found.region, box
        )
        return _make_box(box) if is_inside else None

    def region(self, body: int) -> Box | None:
        """The rectangle of the frame in which a body is expected; None where too little of it is inside."""
        region = self.found.region[body]
        return None if region[0] == NO_REGION else _make_box(region)

    def hidden_pixels(self, body: int) -> NDArray[np.uint8]:
        """Template pixels (n,) of the body at which the compiled fit has stopped: 1 where hidden."""
        start = self._start[body]
        return self.states.covered[start : start + self.templates[body].n_pixels]

    def fit_from(self, part: FilteredPart, position: int, ordinal: int) -> tuple[int, int]:
        """Fit bodies of the ``ordinal``-th tracked frame, from the ``position``-th in order on, in its filtered
        ``part``; returns the position where it stopped, and why (`ALL_DONE`, `DOUBTFUL`, …)."""
        y0, _, x0, _ = part.box
        at, region = self.stop.at, Region(part.coefficient, float(x0), float(y0))
        at[0], at[1] = position, ordinal
        ended = fit_remaining_bodies(
            region, part.n_saturated, self._settings, self._bodies, self.states, self.found, at
        )
        return int(at[0]), ended

    def track_rows(self, film: Film, rows: Rows) -> int:
        return int(track_rows(film, self._settings, self._bodies, self.states, self.found, rows, self.stop))

    def first_fit(self, body: int) -> FirstFit:
        found = self.found
        numbers = found.sums[body].tolist()
        fit = RigidFit(int(numbers[0]), numbers[1], found.normal[body].copy(), ResidualSums(*numbers[3:]), numbers[2])
        arrays = (found.variance, found.covariance, found.inverse, found.ratio, found.blocks)
        out = Assessed(*(array[body].copy() for array in arrays))
        return FirstFit(fit, found.pose[body].copy(), out, int(found.lacking[body]))

    def accepted_fit(self, body: int) -> Fit:
        """Copy of the last fit of a body, by index."""
        found = self.found
        zncc, inlier, noise, gain, seen, level = found.figures[body].tolist()
        return Fit(
            pose=found.pose[body].copy(),
            covariance=found.covariance[body].copy(),
            zncc=zncc,
            inlier=inlier,
            seen=seen,
            gain=gain,
            noise_grey=noise,
            iterations=int(found.sums[body, 0]),
            converged=True,
            coherence=Ratios(found.ratio[body].copy(), found.blocks[body].copy()),
            level=level,
        )


def _starts_and_counts(sizes: Sequence[int], rows: int) -> NDArray[np.int64]:
    """Where arrays of these sizes begin when they follow one another, and their sizes over ``rows``, (m, 2)."""
    ends = np.cumsum([0, *sizes])
    return np.column_stack([ends[:-1], np.array(sizes) // rows]).astype(np.int64)


def _make_box(four: NDArray[np.int64]) -> Box:
    y0, y1, x0, x1 = four.tolist()
    return y0, y1, x0, x1


def _empty_states(motion: Motion, standards: Standards, n: int, n_frame: int) -> States:
    """Work space of the compiled fit: ``n`` pixels of all templates, ``n_frame`` of the picture."""
    m = motion.parent.size
    return States(
        weight=np.ones(n, dtype=np.float32),
        work=np.zeros(5 * n, dtype=np.float32),
        at=np.zeros(n, dtype=np.int32),
        covered=np.zeros(n, dtype=np.uint8),
        scale=np.zeros(m),
        apart=np.zeros(m, dtype=np.uint8),
        motion=motion,
        standards=standards,
        coefficient=np.empty(n_frame, dtype=np.float32),
    )


def _empty_found(m: int) -> FitOutputs:
    """Outputs of the compiled fit for m bodies, to be filled."""
    return FitOutputs(
        expected=np.zeros((m, 3)),
        region=np.full((m, 4), NO_REGION, dtype=np.int64),
        pose=np.zeros((m, 3)),
        covariance=np.zeros((m, 3, 3)),
        ratio=np.zeros((m, N_LEVELS, 3)),
        blocks=np.zeros((m, N_LEVELS, 3)),
        figures=np.zeros((m, 6)),
        sums=np.zeros((m, 10)),
        normal=np.zeros((m, 5, 5)),
        inverse=np.zeros((m, 5, 5)),
        variance=np.zeros((m, 2)),
        lacking=np.zeros(m, dtype=np.int64),
        flag=np.zeros(m, dtype=np.uint16),
    )


MOST_ROWS = 16  # tracked by one compiled call, so that it is heard soon when a run is to end
NEVER = 2**62
Watch = tuple[int, int, tuple[int, int, int]]
"""Which frames compiled code must not take for new ones, ``(n_still, first, (y, x0, x1))``: from frame ``first`` on
those whose pixels x0 .. x1 - 1 of row y are those of the frame before; ``n_still`` frames at the start are at rest."""


def build_repeat_watch(repeats: Repeats, n_still: int) -> Watch:
    return (n_still, max(n_still, 1) if repeats.meaningful else NEVER, repeats.line)


def read_frames_around(film: FrameSource, index: NDArray[np.int64]) -> tuple[int, NDArray[Any], int] | None:
    """Number of the first frame, frames (k, height, width), read-only, and how many frames of numbers ``index`` (n,),
    from the first on, they hold, each with the one before; None of a film whose frames do not lie in memory as they are
    read."""
    # a class that only inherits this may read differently
    if "frames" not in type(film).__dict__ or not index.size:
        return None
    frame_bytes, first = film.width * film.height * (2 if film.bit_depth > 8 else 1), max(int(index[0]) - 1, 0)
    within = int(np.searchsorted(index, first + max(WINDOW_BYTES // frame_bytes, 2)))
    n = min(within, MOST_ROWS, index.size)
    found = film.frames(first, int(index[n - 1]) + 1) if n else None  # type: ignore[attr-defined]
    return None if found is None else (first, found, n)

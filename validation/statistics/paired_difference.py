"""The difference of model and trials, judged: one test for the headline, the bands and the channel table.

Conventions: difference = model − trial of the same trial, mean over the trials of `DifferenceDraws`, rad. Its standard
uncertainty is that of the draws: force, parameters as declared, encoders and film, and the scatter of the trials where
it is larger than these explain. What was not judged is NaN, and ``why`` says so.
"""

from __future__ import annotations

import base64
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from validation.cache.content_hash import sha256_of
from validation.conventions import CHANNEL_GROUPS, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.joint_draws import CHANNELS, JointDraw, chosen_trials, each_draw, joint_draws, session_seed
from validation.prediction.model_under_test import ModelUnderTest
from validation.scores.traces import SessionTraces
from validation.statistics.repeatability import on_common_base

DRAWS = 59  # rank 57 of 60 is the 95 % point exactly
MOST_SAMPLES = 400


@dataclass(frozen=True)
class DifferenceDraws:
    """Differences found and drawn.

    Attributes
    ----------
    time_s : (n_samples,)
    trials : numbers of the trials used
    found : (n_trials, n_samples, 5)
    draws : (N, n_trials, n_samples, 5)
    floor : (5,) smallest standard uncertainty of a mean, one count or the film's
    failed : draws that could not be run
    """

    time_s: Array
    trials: tuple[int, ...]
    found: Array
    draws: Array
    floor: Array
    failed: int


def difference_draws(
    trials: Sequence[MeasuredTrial],
    traces: SessionTraces,
    tested: ModelUnderTest,
    without: Collection[tuple[int, str]] = (),
    n_draws: int = DRAWS,
) -> DifferenceDraws:
    """Run the draws of a session.

    Conventions: model − trial, rad; (…, n_trials, n_samples, n_channels); channels as in `joint_draws.CHANNELS`; NaN
    where a trial is lost, marked, not filmed or wired wrong. Draws are run for at most five trials, taken by lot
    (`joint_draws.chosen_trials`), and the difference found is that of the same trials.

    Parameters
    ----------
    trials : sequence of MeasuredTrial
        All usable trials.
    without : collection of (trial, channel)
        What is not pooled.
    """
    chosen = chosen_trials(trials, without)
    base = traces.base_s
    time = base[:: max(1, base.size // MOST_SAMPLES)]
    numbers = tuple(m.number for m in chosen)
    measured, predicted = (_stack(traces, numbers, time, tail, without) for tail in ("measured", "predicted"))
    found = predicted - measured

    drawn = joint_draws(tested.action, session_seed(trials), n_draws, parameters=True)
    known = tested.identity, sha256_of(drawn)
    stored = tested.store.values(
        "difference draws",
        [(known, m.number, m.force, m.u_rad, m.resolution_rad, m.scale_relative_u, m.film, time) for m in chosen],
        lambda missing: _read(tested, [chosen[i] for i in missing], drawn, time),
    )
    readings = [_decoded(one, (n_draws, time.size, len(CHANNELS))) for one in stored]
    every = np.stack(readings, axis=1).astype(float)
    ran = np.isfinite(every).any(axis=(2, 3)).all(axis=1)
    draws = np.where(np.isfinite(found), predicted - every[ran], np.nan)
    counts = np.array([float(np.mean([abs(m.resolution_rad[i]) for m in chosen])) for i in range(3)])
    floor = np.concatenate([counts / np.sqrt(12.0), np.zeros(len(CHANNELS) - 3)])
    return DifferenceDraws(time, numbers, found, draws, floor, int(n_draws - ran.sum()))


def _read(
    tested: ModelUnderTest, trials: Sequence[MeasuredTrial], draws: Sequence[JointDraw], time: Array
) -> list[dict[str, str]]:
    """Readings of each trial in every draw, (N, n_samples, 5) as text by channel; a draw that cannot be run is NaN."""
    found = each_draw(tested, [(m, time) for m in trials], draws, lambda _, read: read.astype(np.float32))
    nothing = np.full((time.size, len(CHANNELS)), np.nan, dtype=np.float32)
    return [_encoded(np.stack([nothing if one is None else one for one in of_trial])) for of_trial in found]


def _encoded(every: NDArray[np.float32]) -> dict[str, str]:
    known = [name for i, name in enumerate(CHANNELS) if np.isfinite(every[..., i]).any()]
    return {n: base64.b64encode(every[..., CHANNELS.index(n)].tobytes()).decode("ascii") for n in known}


def _decoded(stored: dict[str, str], shape: tuple[int, int, int]) -> NDArray[np.float32]:
    out = np.full(shape, np.nan, dtype=np.float32)
    for name, text in stored.items():
        out[..., CHANNELS.index(name)] = np.frombuffer(base64.b64decode(text), np.float32).reshape(shape[:2])
    return out


def _stack(
    traces: SessionTraces, numbers: tuple[int, ...], time: Array, tail: str, without: Collection[tuple[int, str]]
) -> Array:
    """One kind of curve of every trial and channel, (n_trials, n_samples, 5)."""
    out = np.full((len(numbers), time.size, len(CHANNELS)), np.nan)
    for names, source in CHANNEL_GROUPS:
        every = traces.of(source)
        for name in names:
            for j, number in enumerate(numbers):
                if number in every and (number, name) not in without:
                    column = on_common_base(time, {number: every[number]}, f"{name}_{tail}_rad")
                    out[j, :, CHANNELS.index(name)] = column[:, 0]
    return out


LEVEL = 0.05
FEWEST_FOR_SCATTER = 4
STEADY = 0.25
MOST_NUMBERS = 9  # a sixth of the draws, which must tell their covariance: with 18, u of ln B grew from 1 to 10
SEED = 1989


@dataclass(frozen=True)
class SimultaneousTest:
    """Outcome of the test, and the band it amounts to.

    Attributes
    ----------
    difference, u : (n_samples, n_channels) mean difference, model minus trial, and its standard uncertainty
    scale : (n_samples, n_channels) unit in which the difference is judged, at least ``u``
    factor : largest |D|/scale that a right model reaches in 95 % of sessions; the band is ± factor · scale
    reached : (n_channels,) largest |D|/scale found, NaN where a channel is not known
    largest_at : (n_channels,) its sample
    p : share of draws that reach at least as far; at least 1/(N + 1)
    draws : N
    excess_scatter : whether the trials scatter about the model by more than is declared, and this was added
    log_evidence, u_log_evidence : see `log_evidence`
    """

    difference: Array
    u: Array
    scale: Array
    factor: float
    reached: Array
    largest_at: NDArray[np.int64]
    p: float
    draws: int
    excess_scatter: bool
    log_evidence: float
    u_log_evidence: float

    @property
    def rejected(self) -> bool:
        """Whether the difference lies outside the band anywhere."""
        return bool(np.nanmax(self.reached) > self.factor)


def simultaneous_test(found: Array, draws: Array, floor: Array) -> SimultaneousTest | None:
    """Test the mean over trials.

    Conventions: curves are stacked (…, n_samples, n_channels) in rad; *draws* are differences as they would be if the
    model were right, each with all inputs drawn anew (`validation.prediction.joint_draws`), so their covariance over
    time and channels is that of the declared uncertainties, whatever its form. Source: Monte Carlo test (Besag and
    Clifford 1989). u(t) is the root mean square of the draws; T is the largest |D| over time and channels in units of
    √(u² + u_w²), where u_w is a quarter of the root mean square of u over the window: without it an instant at which
    few draws differ decides, and power is lost (the quarter was chosen by power, on seeds of its own). The difference
    found is one more draw if the model is right, so that it exceeds the draw of rank 0.95 (N + 1) with a probability of
    5 %, however skewed and correlated the curves are. A draw is judged by the others' u. Scatter of the trials enters
    where it is larger than the draws' own (their 95 % rank) and there are at least four trials: random combinations of
    the trials' residuals, with Student's factor, are added to the draws.

    Parameters
    ----------
    found : (n_trials, n_samples, n_channels) array
        Model minus trial, NaN where lost.
    draws : (N, n_trials, n_samples, n_channels) array
        The same as drawn.
    floor : (n_channels,) array
        Smallest standard uncertainty of a mean of this channel.

    Returns
    -------
    SimultaneousTest or None
        None when fewer than 19 draws could be run, or nothing is known.
    """
    n_draws, n_trials = draws.shape[:2]
    if n_draws < 19 or not np.isfinite(found).any():
        return None
    usable = np.isfinite(found) & np.isfinite(draws).all(axis=0)
    count = usable.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(usable, found, 0.0).sum(axis=0) / count
        drawn = np.where(usable, draws, 0.0).sum(axis=1) / count
    known = count > 0
    excess = n_trials >= FEWEST_FOR_SCATTER and _more_scatter(found, draws, usable, mean, drawn)
    if excess:
        residual = np.where(usable, found - mean, 0.0)
        rng = np.random.default_rng([SEED, n_draws, n_trials])
        z = rng.standard_normal((n_draws, n_trials))
        student = np.sqrt((n_trials - 1) / rng.chisquare(n_trials - 1, n_draws))
        extra = np.tensordot(z * student[:, None], residual, axes=1)
        drawn = drawn + extra / np.sqrt(n_trials * (n_trials - 1.0))
    evidence, u_evidence = log_evidence(mean, drawn, floor)
    square = np.where(known, drawn, 0.0) ** 2
    total = square.sum(axis=0)
    u = np.sqrt(total / n_draws + floor**2)
    scale = _steadied(u, known)
    others = _steadied(np.sqrt((total - square) / (n_draws - 1) + floor**2), known)
    reach = (np.sqrt(square) / np.where(others > 0, others, np.inf)).max(axis=(1, 2))
    there = known & (scale > 0)
    ratio = np.where(there, np.abs(np.where(known, mean, 0.0)) / np.where(there, scale, 1.0), -np.inf)
    reached = ratio.max(axis=0)
    found_reach = float(reached.max())
    return SimultaneousTest(
        difference=np.where(known, mean, np.nan),
        u=np.where(known, u, np.nan),
        scale=np.where(known, scale, np.nan),
        factor=_seldom_exceeded(reach),
        reached=np.where(np.isfinite(reached), reached, np.nan),
        largest_at=np.asarray(ratio.argmax(axis=0), dtype=np.int64),
        p=float((1 + (reach >= found_reach).sum()) / (n_draws + 1)),
        draws=n_draws,
        excess_scatter=excess,
        log_evidence=evidence,
        u_log_evidence=u_evidence,
    )


def log_evidence(mean: Array, drawn: Array, floor: Array) -> tuple[float, float]:
    """Natural logarithm of a model's evidence, and its standard uncertainty from the number of draws.

    The draws take parameters, force and sensors from what is declared of them, so that the density which they give to
    the data is the model's evidence (marginal likelihood, also called prior predictive density). Its data are mean
    angles: of each channel in parts of equal length of the window, as many as `MOST_NUMBERS` allow. Density: Student's
    t, which a normal one becomes where mean and covariance are known from N draws alone (Sellentin and Heavens 2016,
    MNRAS 456, L132); its logarithm is a proper score. The difference of two models on the same data is the logarithm of
    their Bayes factor. Uncertainty: jackknife over the draws.

    Parameters
    ----------
    mean : (n_samples, n_channels) array
        Mean difference found, rad, NaN where not known.
    drawn : (N, n_samples, n_channels) array
        The same as drawn.
    floor : (n_channels,) array
        Smallest standard uncertainty of a mean of this channel, rad.

    Returns
    -------
    tuple of float
    """
    channels = np.flatnonzero(np.isfinite(mean).any(axis=0))
    parts = np.array_split(np.arange(len(mean)), max(1, MOST_NUMBERS // channels.size))
    known = [(i, part[np.isfinite(mean[part, i])]) for i in channels for part in parts]
    known = [(i, rows) for i, rows in known if rows.size]
    found = np.array([mean[rows, i].mean() for i, rows in known])
    numbers = np.stack([drawn[:, rows, i].mean(axis=1) for i, rows in known], axis=1)
    least = np.diag([floor[i] ** 2 for i, _ in known])
    every = range(len(drawn))
    without = np.array([_log_density(found, np.delete(numbers, k, axis=0), least) for k in every])
    u = float(np.sqrt((len(drawn) - 1) * without.var()))
    return _log_density(found, numbers, least), u


def _log_density(found: Array, drawn: Array, least: Array) -> float:
    """Of Student's t from draws (N, d), at ``found`` (d,); ``least`` is added to their covariance."""
    n, d = drawn.shape
    free = n - d
    covariance = np.cov(drawn, rowvar=False).reshape(d, d) + least
    variances, axes = np.linalg.eigh(covariance * (n - 1.0) / free * (1.0 + 1.0 / n))
    variances = np.maximum(variances, d * np.finfo(float).eps * variances[-1])  # numbers that always move together
    away = (found - drawn.mean(axis=0)) @ axes / np.sqrt(variances)
    size = -0.5 * np.log(variances).sum() - 0.5 * d * np.log(np.pi * free)
    return float(gammaln(0.5 * n) - gammaln(0.5 * free) + size - 0.5 * n * np.log1p(away @ away / free))


def _steadied(u: Array, known: NDArray[np.bool_]) -> Array:
    """Unit of the statistic, (…, n_samples, n_channels): u and a share of its root mean square over the window."""
    mean_square = np.where(known, u**2, 0.0).sum(axis=-2, keepdims=True) / np.maximum(known.sum(axis=0), 1)
    return np.asarray(np.sqrt(u**2 + STEADY**2 * mean_square))


def _more_scatter(found: Array, draws: Array, usable: NDArray[np.bool_], mean: Array, drawn: Array) -> bool:
    """Whether the trials scatter about their mean difference by more than 95 % of the draws do, in any channel."""
    own = (np.where(usable, found - mean, 0.0) ** 2).sum(axis=(0, 1))
    theirs = (np.where(usable, draws - drawn[:, None], 0.0) ** 2).sum(axis=(1, 2))
    usual = theirs.mean(axis=0)
    there = usual > 0
    if not there.any():
        return bool((own > 0).any())
    reach = _seldom_exceeded((theirs[:, there] / usual[there]).max(axis=1))
    return bool((own[there] / usual[there]).max() > reach)


def _seldom_exceeded(draws: Array) -> float:
    """What one more draw exceeds in 5 % of cases."""
    rank = int(np.ceil((1 - LEVEL) * (draws.size + 1) - 1e-9))
    return float(np.sort(draws)[min(rank, draws.size) - 1])


POINTWISE = 2.0  # standard uncertainties
MOST_FAILED = 0.2  # of the draws: beyond, those that could be run are a selection
SHOWN, NOT_SHOWN, NOT_JUDGED = "model error shown", "within the stated uncertainty", "not judged"


@dataclass(frozen=True)
class Judgement:
    """Draws and test of a session, or why there are none."""

    draws: DifferenceDraws | None = None
    test: SimultaneousTest | None = None
    why: str = "the uncertainty budget was not made"

    def facts(self) -> dict[str, Any]:
        """The test in plain values, for the provenance."""
        if self.draws is None or self.test is None:
            return {"judged": False, "reason": self.why}
        t = self.test
        return {
            "judged": True,
            "level": LEVEL,
            "rejected": t.rejected,
            "p": t.p,
            "factor": t.factor,
            "draws": t.draws,
            "failed_draws": self.draws.failed,
            "trials": list(self.draws.trials),
            "scatter_of_trials_added": t.excess_scatter,
            "log_evidence": t.log_evidence,
            "u_log_evidence": t.u_log_evidence,
        }

    def channel(self, name: str, base_s: Array) -> tuple[Array, Array, Array, dict[str, object]]:
        """The judged difference of one channel at times ``base_s`` (n,), and what it amounts to.

        Mean difference, its u, and half width of the simultaneous 95 % band, (n,) rad each; values of the channel
        table.
        """
        nan = float("nan")
        nothing = np.full(base_s.size, nan)
        i = CHANNELS.index(name)
        if self.draws is None or self.test is None or not np.isfinite(self.test.reached[i]):
            row: dict[str, object] = dict.fromkeys(COLUMNS, nan)
            return nothing, nothing.copy(), nothing.copy(), row | {"judgement": NOT_JUDGED}
        t, time = self.test, self.draws.time_s
        size, u, scale = np.abs(t.difference[:, i]), t.u[:, i], t.scale[:, i]
        known = np.isfinite(size)
        right = np.sqrt(np.nanmean(self.draws.draws[..., i] ** 2, axis=(1, 2)))
        row = {
            "mean_difference_rad": float(np.sqrt(np.mean(size[known] ** 2))),
            "u_difference_rad": float(np.sqrt(np.mean(u[known] ** 2))),
            "largest_ratio": float(t.reached[i]),
            "largest_ratio_difference_rad": float(t.difference[t.largest_at[i], i]),
            "largest_ratio_at_s": float(time[t.largest_at[i]]),
            "ratio_limit": t.factor,
            "resolved_share": float(np.mean(size[known] > t.factor * scale[known])),
            "resolved_pointwise_share": float(np.mean(size[known] > POINTWISE * u[known])),
            "rmse_right_rad": float(np.median(right)),
            "rmse_right_95_rad": _seldom_exceeded(right),
            "judgement": SHOWN if t.reached[i] > t.factor else NOT_SHOWN,
        }
        mean, u_base, unit = (np.interp(base_s, time[known], v[known]) for v in (t.difference[:, i], u, scale))
        return mean, u_base, t.factor * unit, row


COLUMNS = (
    "mean_difference_rad",
    "u_difference_rad",
    "largest_ratio",
    "largest_ratio_difference_rad",
    "largest_ratio_at_s",
    "ratio_limit",
    "resolved_share",
    "resolved_pointwise_share",
    "rmse_right_rad",
    "rmse_right_95_rad",
)


def judge(draws: DifferenceDraws) -> Judgement:
    """Test a session's difference, unless too many draws failed."""
    n = len(draws.draws) + draws.failed
    if draws.failed > MOST_FAILED * n:
        return Judgement(draws, None, f"{draws.failed} of {n} draws of the declared uncertainties cannot be simulated")
    test = simultaneous_test(draws.found, draws.draws, draws.floor)
    return Judgement(draws, test, "" if test is not None else "no sample is known in model and trials")

"""The public comparisons; the stages behind them are imported when one runs, so that their names cost little."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

if TYPE_CHECKING:
    import model
    from rig.session import Session
    from validation.options import CompareOptions
    from validation.result import ValidationResult
    from validation.side_by_side import SideBySide


def compare(
    session: Session | str | Path,
    action: model.Action | str | Path = "hirschkorn2004",
    **options: Unpack[CompareOptions],
) -> ValidationResult:
    """Compare every usable trial of a session with the model's prediction under its own force; return scores, findings,
    verdict and tables. Unless ``keep_predictions`` is False, results are stored in the session's folder ``derived`` and
    reused.

    Parameters
    ----------
    session : Session or path
    action : model.Action, name or path
    **options
        tolerance : float, default 1e-5
            Requested largest error of any predicted angle, rad.
        rivals : tuple of str, default ("null", "raw_force", "unfitted", "polynomial", "fir", "fir_lags")
            What is scored beside the model: the null model, the model under the recorded force, the values before an
            identification, and three black boxes (`validation.statistics.rivals`).
        budget : bool, default True
            Draw the uncertain inputs, some 220 runs of one trial; without them there is no verdict.
        explain : bool or None, default None
            Find the causes that explain what model and trials, and the trials among themselves, differ by: always,
            never, or (None) where the verdict resolves a difference or a trial is odd.
        effects : bool, default True
            Whether effects that the model lacks are among the causes; each compiles a scene of its own once, half a
            minute in all.
        by_motion : bool, default False
            Drive the model by the key's measured motion instead of the force, in all trials; where no force was
            recorded it always does. Also compare the force that the motion needs, in the trial of median peak force.
        further : bool, default False; True where a report is written
            Also make the tables that only a report shows: forces and energies inside the action, the force that the
            motion of the key needs.
        keep_predictions : bool, default True
            Store predictions and scores in the session's ``derived`` and reuse them when their inputs have not changed.
        u_rest_level_m : float, default 0.1 mm / √3
            Standard uncertainty of hammer height and key dip at rest on the bench.
        condition : str, optional
            Condition of the session's trial plan to compare; needed where usable trials are of several.
        relevant : dict, optional
            Limits from which a difference matters, of `validation.verdict.quantities.RELEVANT`: ``travel`` (share of a
            channel's travel, default 0.05), ``check_height`` (m, 2e-3), ``let_off`` (m, 5e-4), ``time`` (s, 2e-3),
            ``speed`` (share, 0.05).
        predict, rest_state, geometry : callable, optional
            Stand-ins for ``model.simulate``, ``model.rest_state`` and `validation.measurement.geometry.geometry_of`.
        now : callable
            The clock of the report's date.
        progress : callable, optional
            Called with a line of text per trial.

    Returns
    -------
    ValidationResult
        ``to_frame()`` has the curves, ``to_frame("quantities")`` those of the verdict; ``plot("hammer")``, ``save()``.

    Raises
    ------
    ValidationInputError
        When the session or the action cannot be used, or no trial is usable.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import validation
    >>> result = validation.compare("sessions/example_forte", "hirschkorn2004", budget=False, explain=False)
    >>> hammer = result.channels.set_index("channel").loc["hammer"]
    >>> bool(hammer.s_r_rad < hammer.rmse_rad < 0.01)  # beyond the scatter of the trials, but small
    True
    """
    # start-up: a second of processor time, which asking for the name does not need
    from validation.measurement.measure_session import open_session
    from validation.options import ComparisonOptions
    from validation.pipeline.compare_session import compare_by, load_model

    chosen = ComparisonOptions.from_keywords(options)
    return compare_by(open_session(session), load_model(action), chosen)


def compare_many(
    sessions: Sequence[Session | str | Path],
    actions: Sequence[model.Action | str | Path] = ("hirschkorn2004",),
    **options: Unpack[CompareOptions],
) -> SideBySide:
    """Compare every session with every model, as `compare` does; a session that fails is named in ``refused`` and the
    rest goes on. Raises an input error where none can be compared or a model cannot be read.

    Parameters
    ----------
    sessions : sequence of Session or path
        A session of several conditions counts as one session for each, unless ``condition`` chooses.
    actions : sequence of name, path or model.Action
    **options
        Those of `validation.compare`; ``condition`` holds for all sessions.

    Returns
    -------
    SideBySide
        One result for each session and model, and how the models compare.

    Raises
    ------
    ValidationInputError
        A session or a model is given twice, a model cannot be read, or no session can be compared.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import validation
    >>> models = ["hirschkorn2004", "hirschkorn2004-regulated"]
    >>> side = validation.compare_many(["sessions/example_forte"], models, budget=False, explain=False)
    >>> [result.action_name for result in side.results]
    ['hirschkorn2004', 'hirschkorn2004-regulated']
    """
    # start-up: a second of processor time, which asking for the name does not need
    from validation.options import ComparisonOptions
    from validation.pipeline.compare_sessions import compare_every

    return compare_every(sessions, actions, ComparisonOptions.from_keywords(options, "validation.compare_many"))


def validate_sessions(
    sessions: Sequence[Session | str | Path],
    actions: Sequence[model.Action | str | Path] = ("hirschkorn2004",),
    out: str | Path | None = None,
    **options: Unpack[CompareOptions],
) -> SideBySide:
    """Compare every session with every model and write one report (page, results, tables, curves) into the folder
    ``out``, replacing an older one; returns the results with the files written.

    Parameters
    ----------
    sessions : sequence of Session or path
    actions : sequence of name, path or model.Action
    out : path, optional
        Folder for ``report.html``, ``results.json`` and ``tables/*.csv``; by default that of the session, if it is one.
    **options
        Those of `validation.compare`.

    Returns
    -------
    SideBySide
        With ``files`` naming what was written.

    Raises
    ------
    ValidationInputError
        No session can be compared, a session or model is given twice, or the folder cannot be written.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import validation
    >>> side = validation.validate_sessions(["sessions/example_forte"], out="report", budget=False, explain=False)
    >>> side.files["report.html"].name
    'report.html'
    """
    # start-up: a second of processor time, which asking for the name does not need
    from rig.session import Session
    from validation.cache.report_cache import report_folder
    from validation.options import CompareOptions, ComparisonOptions
    from validation.report.files import check_folder

    chosen = ComparisonOptions.from_keywords(options, "validation.validate_sessions")
    folder = report_folder([s.path if isinstance(s, Session) else s for s in sessions], out)
    check_folder(folder)  # before any work is done
    side = compare_many(sessions, actions, **CompareOptions({"further": True, **options}))
    chosen.say("writing the report")
    # start-up: what only draws comes last
    from validation.report.write import write_side_by_side

    return write_side_by_side(side, folder)


def validate_session(
    session: Session | str | Path,
    action: model.Action | str | Path = "hirschkorn2004",
    out: str | Path | None = None,
    **options: Unpack[CompareOptions],
) -> ValidationResult:
    """Compare one session with one model and write the report into the folder ``out``, by default the session's;
    returns the result with the files written.

    Parameters
    ----------
    session : Session or path
    action : name, path or model.Action
    out : path, optional
        Folder for the report; by default that of the session.
    **options
        Those of `validation.compare`.

    Returns
    -------
    ValidationResult
        With ``files`` naming what was written.

    Raises
    ------
    ValidationInputError
        The session cannot be compared, or the folder cannot be written.
    TypeError
        A keyword that is not known.

    Examples
    --------
    >>> import validation
    >>> result = validation.validate_session("sessions/example_forte", out="one", budget=False, explain=False)
    >>> "report.html" in result.files
    True
    """
    return validate_sessions([session], [action], out, **options).results[0]

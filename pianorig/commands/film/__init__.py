"""Commands of the film: attaching it to a trial, calibrating the camera, tracking the bodies.

In: film files, options as typed; out: films beside their trials, camera files, tables of angles, pictures.
The work is done by ``pianorig.workflows.film`` and ``vision``.
"""

"""Scenes: which bodies, contacts, springs, drives and effects take part in a run."""

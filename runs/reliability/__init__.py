"""Reliability, tried and counted: faults on purpose, and what must hold all the same.

A row (`row.py`) is data: what is done, what must hold, how often it is tried. `rows.py` gathers
those of the files beside it. `python -m runs.reliability` tries all of them as often as they say
and writes the counts that `docs/reliability.md` shows; the tests try each once.
"""

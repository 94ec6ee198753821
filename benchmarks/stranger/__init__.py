"""A machine by somebody who has never seen the formulas of `pido.diagnosis`, and an examination on it.

    python -m benchmarks.stranger --cases 50 --seed 1 --workers 2 --out out/stranger

`machine` draws a plant, `motion` its programs, `parts` what its axes, spindle and process really do; `friction`,
`effects` and `outside` are what a simulation conceals (`law`), `faults` what is wrong with data, `fairness` says which
cases can be decided at all; `cases` draws one (`sealed`), `files` writes it; the command asks `pido diagnose`
and `pido correct` blind and judges the answers.
"""

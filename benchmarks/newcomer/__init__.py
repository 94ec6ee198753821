"""Kinds of machines by somebody who has seen neither the formulas of `pido.diagnosis` nor those of other cases.

    python -m benchmarks.newcomer --cases 50 --seed 1 --workers 2 --out out/newcomer

`machines` draws one, `toolpaths`, `programs` and `interpolator` move it, `cutting` and `parts` say what happens on it;
`world` is what a simulation says of that; `axes`, `process` and `foreign` are what it conceals (`catalogue`), `faults`
what is wrong with data; `noise` and `assembly` make the currents, `fair` says which draws can be decided; `boxes` are
what a law is confined to; `planned` says what to draw, `draw` draws it, `folders` writes it. There are seven kinds, in
a `second` edition eight others and in a `third` ten: `editions` says what differs. The examination is
`benchmarks.sealed_cases`.
"""

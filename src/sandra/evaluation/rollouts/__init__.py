"""Certificates against adversaries: the others play anything, the ego drives what was certified.

`cases` makes certificates, `ego` drives them; `adversary`, `actors`, `walkers` and `traffic` move
the others along `routes` on the `road`; `referee`, `contact`, `blame` and `rules` judge each
`rollout`; `soundness` counts many, with `statistics` and a `report`.
"""

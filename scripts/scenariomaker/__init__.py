"""The project's own scenarios, from road geometry to files. See scripts/make_scenarios.py."""

from scenariomaker.country import roadworks, rural_oncoming
from scenariomaker.motorway import highway_dense, merge, nothing_safe, recorded_ego
from scenariomaker.urban import intersection, urban_parked

SCENARIOS = {
    "intersection": intersection,
    "highway-dense": highway_dense,
    "merge": merge,
    "rural-oncoming": rural_oncoming,
    "urban-parked": urban_parked,
    "nothing-safe": nothing_safe,
    "recorded-ego": recorded_ego,
    "roadworks": roadworks,
}
"""Short name -> function that makes it."""

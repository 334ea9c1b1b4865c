"""Drive commonroad-reactive-planner inside a driving corridor. Runs in an environment of its own.

    .venv-planner/bin/python plan.py corridor.json trajectory.json

Reads what `sandra verify --corridor` writes, and nothing else: the corridor, the road, the others.
Writes a trajectory: states x, y of the body's centre, heading, speed, one per dt; null where the
planner finds none. Whether it is safe is not decided here.
"""

import json
import sys
from pathlib import Path

import numpy as np
import shapely
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.scenario import Scenario, ScenarioID
from commonroad_clcs.config import CLCSParams
from commonroad_dc import pycrcc
from commonroad_dc.boundary.boundary import create_road_boundary_obstacle
from commonroad_rp.cost_function import DefaultCostFunction
from commonroad_rp.reactive_planner import ReactivePlanner
from commonroad_rp.sampling.base.base_sampling_space import SamplingSpace
from commonroad_rp.state import ReactivePlannerState
from commonroad_rp.utility.config import ReactivePlannerConfiguration, VehicleConfiguration
from commonroad_rp.utility.utils_coordinate_system import CoordinateSystem

MARGIN = 0.1
"""Distance that the body keeps from where the others may be [m]."""
NEAR = 0.01
"""The planner's frame and ours agree up to this [m]."""
SMALL = 0.05
"""Accelerations keep this distance from the ends of their range [m/s^2]."""
LEVELS = 4
"""The planner samples ever more densely, until a sample holds."""


class Corridor:
    """The corridor's parts as arrays, one row per part."""

    def __init__(self, data: dict) -> None:
        self.dt, self.horizon = data["dt"], data["horizon"]
        names = ("s", "d", "speed", "acceleration")
        self.steps = [
            {name: np.array([part[name] for part in step]) for name in names}
            for step in data["steps"]
        ]
        self.top = data["limits"]["speed"]
        self.lowest, self.highest = data["limits"]["acceleration"]

    def speeds(self, time: float) -> tuple[float, float]:
        """The range of ds/dt at a time; beyond the horizon, what can be made of that at its end."""
        k = min(round(time / self.dt), self.horizon)
        more = max(time - self.horizon * self.dt, 0.0)
        low, high = self.steps[k]["speed"][:, 0].min(), self.steps[k]["speed"][:, 1].max()
        # A rule may want a speed strictly below a bound: not its very ends.
        low, high = low + (high - low) / 20, high - (high - low) / 20
        return max(low + self.lowest * more, 0.0), min(high + self.highest * more, self.top)

    def offsets(self) -> list[tuple[float, float]]:
        """The disjoint ranges of d at the horizon."""
        found: list[tuple[float, float]] = []
        for low, high in sorted(self.steps[-1]["d"].tolist()):
            if found and low <= found[-1][1]:
                found[-1] = found[-1][0], max(found[-1][1], high)
            else:
                found.append((low, high))
        return found

    def aim(self, lateral: str) -> float:
        """The offset that suits the action: the lane's centre, or the middle of the next lane."""
        ranges = self.offsets()
        if lateral == "follow-lane":
            return min((float(np.clip(0.0, *each)) for each in ranges), key=abs)
        low, high = ranges[-1] if lateral == "left-lane" else ranges[0]
        return (low + high) / 2

    def accelerations(self, k: int, narrower: float = SMALL) -> tuple[float, float]:
        """The range of the acceleration that follows step k, a little narrower."""
        low, high = self.steps[k]["acceleration"][:, 0].min(), self.steps[k]["acceleration"].max()
        small = min(narrower, (high - low) / 4)
        return low + small, high - small

    def holds(self, k: int, s: float, d: float, speed: float) -> bool:
        """Whether a state at step k lies in one of the parts."""
        part = self.steps[k]
        inside = np.ones(len(part["s"]), dtype=bool)
        for name, value, slack in (("s", s, NEAR), ("d", d, NEAR), ("speed", speed, 5 * NEAR)):
            inside &= part[name][:, 0] - slack <= value
            inside &= value <= part[name][:, 1] + slack
        return bool(inside.any())


class InCorridor(SamplingSpace):
    """The planner's sampling space: ends within the corridor, and what leaves it on the way drops.

    (The planner's own corridor sampling needs CommonRoad-Reach, whose sets it then samples; it
    looks at the end of a sample only.)
    """

    def __init__(self, corridor: Corridor, ahead: float, shift: float) -> None:
        super().__init__(LEVELS, corridor.dt, 2 * corridor.horizon * corridor.dt)
        self.corridor, self.ahead, self.shift = corridor, ahead, shift

    def set_t_sampling(self, t_min):
        """The corridor says what is sampled."""

    def set_d_sampling(self, d_min, d_max):
        """The corridor says what is sampled."""

    def set_v_sampling(self, v_min, v_max):
        """The corridor says what is sampled."""

    def set_s_sampling(self, s_min, s_max):
        """The corridor says what is sampled."""

    def _get_time_samples(self, level_sampling, **kwargs):
        # Beyond the horizon too: a sample ends with acceleration 0, which few actions allow.
        steps = self.corridor.horizon * np.linspace(0.6, 2.0, 4 * (level_sampling + 1))
        return self.dt * np.round(steps)

    def _get_lon_samples(self, level_sampling, longitudinal_mode, **kwargs):
        return np.linspace(*self.corridor.speeds(kwargs["t_sample"]), 6 * 2**level_sampling)

    def _get_lat_samples(self, level_sampling, **kwargs):
        found = set()
        for low, high in self.corridor.offsets():
            found |= set(np.linspace(low, high, 4 * (level_sampling + 1)).tolist())
            found |= {d for d in (0.0, kwargs["x_0_lat"][0]) if low <= d <= high}
        return found

    def generate_trajectories_at_level(
        self, level_sampling, x_0_lon, x_0_lat, longitudinal_mode, low_vel_mode
    ):
        """Those samples that stay in the corridor at every step up to the horizon."""
        sampled = super().generate_trajectories_at_level(
            level_sampling, x_0_lon, x_0_lat, longitudinal_mode, low_vel_mode
        )
        return [sample for sample in sampled if self._stays(sample, low_vel_mode)]

    def _stays(self, sample, over_distance: bool) -> bool:
        begin = sample.trajectory_long.evaluate_state_at_tau(0.0)[0]
        end = sample.trajectory_long.delta_tau
        for k in range(self.corridor.horizon + 1):
            time = min(k * self.dt, end)
            s, speed, acceleration = sample.trajectory_long.evaluate_state_at_tau(time)
            place = s - begin if over_distance else time
            d, rate, _ = sample.trajectory_lat.evaluate_state_at_tau(place)
            slope = rate if over_distance else rate / speed if speed > 0.1 else 0.0
            # Samples are of the rear axle, the corridor is of the body's centre.
            angle = np.arctan(slope)
            s += speed * max(k * self.dt - end, 0.0) + self.ahead * np.cos(angle) + self.shift
            d += self.ahead * np.sin(angle)
            if not self.corridor.holds(k, s, d, speed):
                return False
            low, high = self.corridor.accelerations(k)
            if k * self.dt >= end:
                acceleration = 0.0
            if k < self.corridor.horizon and not low <= acceleration <= high:
                return False
        return True


def configuration(data: dict) -> ReactivePlannerConfiguration:
    """The planner's settings: our vehicle, our bounds, twice our horizon."""
    ego, limits = data["ego"], data["limits"]
    config = ReactivePlannerConfiguration()
    config.vehicle = VehicleConfiguration(
        length=ego["length"],
        width=ego["width"],
        wb_front_axle=ego["wheelbase"] / 2,
        wb_rear_axle=ego["wheelbase"] / 2,
        a_max=min(-limits["acceleration"][0], limits["acceleration"][1]),
        v_switch=limits["speed"],
        delta_min=-limits["steering_angle"],
        delta_max=limits["steering_angle"],
        v_delta_min=-limits["steering_rate"],
        v_delta_max=limits["steering_rate"],
    )
    config.planning.dt = data["dt"]
    config.planning.time_steps_computation = 2 * data["horizon"]
    config.sampling.num_sampling_levels = LEVELS
    config.debug.multiproc = False
    config.debug.logging_level = "ERROR"
    network = LaneletNetwork()
    for number, lanelet in enumerate(data["road"], start=1):
        left, right = np.array(lanelet["left"]), np.array(lanelet["right"])
        network.add_lanelet(Lanelet(left, (left + right) / 2, right, number))
    scenario = Scenario(data["dt"], ScenarioID())
    scenario.replace_lanelet_network(network)
    config.update(scenario=scenario)
    return config


def collision_checker(data: dict, scenario: Scenario) -> pycrcc.CollisionChecker:
    """The border of the road, and where the others may be at and around each step."""
    checker = pycrcc.CollisionChecker()
    checker.add_collision_object(create_road_boundary_obstacle(scenario)[1])
    for other in data["others"]:
        moving = pycrcc.TimeVariantCollisionObject(0)
        for k in range(data["horizon"] + 1):
            group = pycrcc.ShapeGroup()
            for regions in other["between"][max(k - 1, 0) : k + 1]:
                for region in regions:
                    add(group, region)
            moving.append_obstacle(group)
        checker.add_collision_object(moving)
    return checker


def add(group: pycrcc.ShapeGroup, region: dict) -> None:
    """A region, widened by `MARGIN`, as triangles."""
    hull = shapely.MultiPoint(region["vertices"]).convex_hull
    ring = np.array(hull.buffer(region["radius"] + MARGIN, quad_segs=4).exterior.coords)[:-1]
    for i in range(1, len(ring) - 1):
        group.add_shape(pycrcc.Triangle(*ring[0], *ring[i], *ring[i + 1]))


def initial_state(data: dict, corridor: Corridor, ahead: float) -> ReactivePlannerState:
    """The ego's state at its rear axle; its acceleration is one that the corridor allows."""
    ego = data["ego"]
    along = np.array([np.cos(ego["heading"]), np.sin(ego["heading"])])
    slip = np.arctan(np.tan(ego["steering_angle"]) / 2)
    speed = ego["speed"] * np.cos(slip)
    return ReactivePlannerState(
        time_step=0,
        position=np.array([ego["x"], ego["y"]]) - ahead * along,
        orientation=ego["heading"],
        velocity=speed,
        acceleration=float(np.clip(ego["acceleration"], *corridor.accelerations(0, 2 * SMALL))),
        steering_angle=ego["steering_angle"],
        yaw_rate=speed * np.tan(ego["steering_angle"]) / ego["wheelbase"],
    )


def plan(data: dict) -> dict:
    """The planner's best trajectory in the corridor, or why there is none."""
    corridor = Corridor(data)
    ego = data["ego"]
    ahead = ego["wheelbase"] / 2
    config = configuration(data)
    planner = ReactivePlanner(config)
    planner.reset(
        config,
        initial_state_cart=initial_state(data, corridor, ahead),
        collision_checker=collision_checker(data, config.scenario),
        coordinate_system=CoordinateSystem(
            np.array(data["reference"]), preprocess_reference=False, clcs_params=CLCSParams()
        ),
    )
    # Both frames follow the same line, but the planner's prolongs it at its start.
    s, _ = planner.coordinate_system.convert_to_curvilinear_coords(ego["x"], ego["y"])
    planner.set_sampling_space(InCorridor(corridor, ahead, ego["s"] - s))
    low, high = corridor.speeds(corridor.horizon * corridor.dt)
    planner.set_cost_function(
        DefaultCostFunction(
            desired_speed=float(np.clip(ego["speed"], low, high)),
            desired_d=corridor.aim(data["pair"]["lateral"]),
        )
    )
    result = planner.plan()
    told = {
        "planner": "commonroad-reactive-planner",
        "step": data["dt"],
        "samples": planner.total_count_samples,
        "infeasible": planner.infeasible_count_kinematics,
        "colliding": planner.infeasible_count_collision,
    }
    if result is None:
        return {**told, "states": None}
    states = []
    for state in result[0].state_list[: data["horizon"] + 1]:
        centre = ReactivePlannerState.shift_state_to_center(state, ahead)
        slip = np.arctan(np.tan(state.steering_angle) / 2)
        speed = state.velocity / np.cos(slip)
        states.append([*centre.position.tolist(), float(state.orientation), float(speed)])
    return {**told, "states": states}


def main() -> None:
    corridor, trajectory = map(Path, sys.argv[1:3])
    planned = plan(json.loads(corridor.read_text(encoding="utf-8")))
    trajectory.write_text(json.dumps(planned), encoding="utf-8")


if __name__ == "__main__":
    main()

"""Between rows of float64 arrays, which Python holds, and the NamedTuples that kernels work with.

Written out because the compiler turns a loop over a tuple's fields into code ten times slower.
"""

import numpy as np
from numpy.typing import NDArray

from vvc_bench.jit import kernel
from vvc_bench.sim.fields import Conditions, Goal, State
from vvc_bench.sim.task import Memory, Task


@kernel
def load_state(rows: NDArray[np.float64], i: int) -> State:
    """The state that a row holds."""
    return State(
        airspeed=rows[i, 0],
        angle_of_attack=rows[i, 1],
        sideslip=rows[i, 2],
        roll_rate=rows[i, 3],
        pitch_rate=rows[i, 4],
        yaw_rate=rows[i, 5],
        quaternion_w=rows[i, 6],
        quaternion_x=rows[i, 7],
        quaternion_y=rows[i, 8],
        quaternion_z=rows[i, 9],
        north=rows[i, 10],
        east=rows[i, 11],
        altitude=rows[i, 12],
        forward_velocity=rows[i, 13],
        side_velocity=rows[i, 14],
        normal_velocity=rows[i, 15],
        velocity_north=rows[i, 16],
        velocity_east=rows[i, 17],
        velocity_up=rows[i, 18],
        roll=rows[i, 19],
        pitch=rows[i, 20],
        yaw=rows[i, 21],
        speed=rows[i, 22],
        path_angle=rows[i, 23],
        azimuth=rows[i, 24],
        load_factor_x=rows[i, 25],
        load_factor_y=rows[i, 26],
        load_factor=rows[i, 27],
        aileron=rows[i, 28],
        elevator=rows[i, 29],
        rudder=rows[i, 30],
        throttle=rows[i, 31],
        thrust=rows[i, 32],
        load_factor_integral=rows[i, 33],
        roll_rate_integral=rows[i, 34],
        gust_forward=rows[i, 35],
        gust_side=rows[i, 36],
        gust_side_lagged=rows[i, 37],
        gust_normal=rows[i, 38],
        gust_normal_lagged=rows[i, 39],
        steps=rows[i, 40],
        clipped_commands=rows[i, 41],
    )


@kernel
def store_state(state: State, rows: NDArray[np.float64], i: int) -> None:
    """Write a state into a row."""
    rows[i, 0] = state.airspeed
    rows[i, 1] = state.angle_of_attack
    rows[i, 2] = state.sideslip
    rows[i, 3] = state.roll_rate
    rows[i, 4] = state.pitch_rate
    rows[i, 5] = state.yaw_rate
    rows[i, 6] = state.quaternion_w
    rows[i, 7] = state.quaternion_x
    rows[i, 8] = state.quaternion_y
    rows[i, 9] = state.quaternion_z
    rows[i, 10] = state.north
    rows[i, 11] = state.east
    rows[i, 12] = state.altitude
    rows[i, 13] = state.forward_velocity
    rows[i, 14] = state.side_velocity
    rows[i, 15] = state.normal_velocity
    rows[i, 16] = state.velocity_north
    rows[i, 17] = state.velocity_east
    rows[i, 18] = state.velocity_up
    rows[i, 19] = state.roll
    rows[i, 20] = state.pitch
    rows[i, 21] = state.yaw
    rows[i, 22] = state.speed
    rows[i, 23] = state.path_angle
    rows[i, 24] = state.azimuth
    rows[i, 25] = state.load_factor_x
    rows[i, 26] = state.load_factor_y
    rows[i, 27] = state.load_factor
    rows[i, 28] = state.aileron
    rows[i, 29] = state.elevator
    rows[i, 30] = state.rudder
    rows[i, 31] = state.throttle
    rows[i, 32] = state.thrust
    rows[i, 33] = state.load_factor_integral
    rows[i, 34] = state.roll_rate_integral
    rows[i, 35] = state.gust_forward
    rows[i, 36] = state.gust_side
    rows[i, 37] = state.gust_side_lagged
    rows[i, 38] = state.gust_normal
    rows[i, 39] = state.gust_normal_lagged
    rows[i, 40] = state.steps
    rows[i, 41] = state.clipped_commands


@kernel
def load_conditions(rows: NDArray[np.float64], i: int) -> Conditions:
    """The conditions that a row holds."""
    return Conditions(
        wind_north=rows[i, 0],
        wind_east=rows[i, 1],
        wind_up=rows[i, 2],
        gust_intensity=rows[i, 3],
        seed=rows[i, 4],
        density_offset=rows[i, 5],
        mass_offset=rows[i, 6],
        actuator_time_constant=rows[i, 7],
        actuator_rate_limit=rows[i, 8],
        engine_time_constant=rows[i, 9],
        delay_steps=rows[i, 10],
        sensor_noise=rows[i, 11],
    )


@kernel
def load_goal(rows: NDArray[np.float64], i: int) -> Goal:
    """The goal that a row holds."""
    return Goal(speed=rows[i, 0], path_angle=rows[i, 1], azimuth=rows[i, 2])


@kernel
def load_task(row: NDArray[np.float64]) -> Task:
    """The task that an array holds."""
    return Task(
        speed_band=row[0],
        direction_band=row[1],
        reach_steps=row[2],
        step_limit=row[3],
        speed_weight=row[4],
        direction_weight=row[5],
        speed_scale=row[6],
        direction_scale=row[7],
        exponent=row[8],
        discount=row[9],
        reward=row[10],
        penalty=row[11],
        constant_penalty=row[12],
        least_altitude=row[13],
        largest_speed=row[14],
        largest_roll_rate=row[15],
        move_away_steps=row[16],
        largest_roll_on=row[17],
        steep_bank=row[18],
        least_load_factor=row[19],
        negative_load_steps=row[20],
        terminations=row[21],
        rules=row[22],
    )


@kernel
def load_memory(rows: NDArray[np.float64], i: int) -> Memory:
    """The memory that a row holds."""
    return Memory(
        steps=rows[i, 0],
        steps_on_goal=rows[i, 1],
        steps_in_band=rows[i, 2],
        direction_error=rows[i, 3],
        steps_moving_away=rows[i, 4],
        path_angle_error=rows[i, 5],
        azimuth_error=rows[i, 6],
        steps_path_angle_away=rows[i, 7],
        steps_azimuth_away=rows[i, 8],
        rolled=rows[i, 9],
        steps_negative_load=rows[i, 10],
    )


@kernel
def store_memory(memory: Memory, rows: NDArray[np.float64], i: int) -> None:
    """Write a memory into a row."""
    rows[i, 0] = memory.steps
    rows[i, 1] = memory.steps_on_goal
    rows[i, 2] = memory.steps_in_band
    rows[i, 3] = memory.direction_error
    rows[i, 4] = memory.steps_moving_away
    rows[i, 5] = memory.path_angle_error
    rows[i, 6] = memory.azimuth_error
    rows[i, 7] = memory.steps_path_angle_away
    rows[i, 8] = memory.steps_azimuth_away
    rows[i, 9] = memory.rolled
    rows[i, 10] = memory.steps_negative_load

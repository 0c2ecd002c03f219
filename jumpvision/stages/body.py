"""Masses and foot of the robot, where they are known."""

from __future__ import annotations

from ..sections import Robot


def total_mass(robot: Robot | None) -> float | None:
    """Mass of motor and rod [kg], where both are known."""
    return robot.motor_mass + robot.rod_mass if robot and robot.motor_mass and robot.rod_mass else None


def hanging_foot(robot: Robot | None) -> tuple[float, float, float, float] | None:
    """k, m_f, M, g of a robot with a foot, where they are known."""
    mass = total_mass(robot)
    if robot is None or mass is None or not (robot.foot_mass and robot.spring_stiffness):
        return None
    return robot.spring_stiffness, robot.foot_mass, mass, robot.gravity

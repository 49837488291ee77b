"""Models of a region: stations, drones, wind, queues, compositions; units, geodesy and errors.

This package does not depend on planners, missions or vehicles. Conventions (units, signs, frames) are fixed in
:mod:`models.base.units` and hold in every module.
"""

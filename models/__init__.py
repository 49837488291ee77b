"""The world model: stations, drones, wind, queues, services; units, geodesy and errors.

Nothing here knows of planners, missions or vehicles. Conventions (units, signs, frames) are fixed in
:mod:`models.base.units` and hold in every module.
"""

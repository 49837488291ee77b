"""Flights in drawn fields of the wind that no site tells: a referee."""

import numpy as np


def drawn_times(problem, segments, member, slot, rng, draws):
    """Time in the air over segments in drawn winds, s, by the wind triangle at every kilometre."""
    air, network, wind = problem.air, problem.network, problem.ensemble
    places = []
    for one in segments:
        count = int(air.distance_m[one] // 1000.0) + 1
        places += [(one, (k + 0.5) / count, air.distance_m[one] / count) for k in range(count)]
    of = np.array([one for one, _, _ in places])
    share, length = np.array([share for _, share, _ in places]), np.array([metres for _, _, metres in places])
    a, b = network.tail[of], network.head[of]
    lat, lon = (at[a] + share * (at[b] - at[a]) for at in (network.lat, network.lon))
    field = problem.scenario.field_error
    calm = field.covariance(lat, lon, wind.weights(lat, lon), wind.site_lat, wind.site_lon)
    value, vector = np.linalg.eigh(calm)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    north, east = (air.weight[of] @ part[member, slot] for part in (air.north, air.east))
    rough = np.sqrt(field.in_wind(np.hypot(north, east)))
    drawn = rng.normal(size=(2, draws, len(of))) @ root.T
    n, e = north + rough * drawn[0], east + rough * drawn[1]
    along = n * air.cos_bearing[of] + e * air.sin_bearing[of]
    across = e * air.cos_bearing[of] - n * air.sin_bearing[of]
    speed = along + np.sqrt(np.maximum(air.airspeed_mps**2 - across**2, 0.0))
    return (length / np.clip(speed, 1.0, air.max_ground_speed_mps)).sum(axis=1)

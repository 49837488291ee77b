"""Proof of delivery, evaluated by the simulator's own physics: good releases and injected failures, on both autopilots.

Each delivery: take-off with the package, a leg, landing, release, take-off again; every fifth by winch, in the air. The simulator's power and drag are
not those by which the package is weighed; each vehicle draws up to 5 % more or less than its model, wind and gusts blow, the wind shifts on the ground, and the
wind given to the scale has an error. The supervisor's own `Proof` weighs and judges, with the data of the link as input.

``python -m benchmarks.link.proof --good 1000 --bad 200``; with ``--heard FILE`` the inputs of the proof are stored, and ``--again FILE`` evaluates them again, without
a simulation: a change of the scale is evaluated in a minute. ``--ways N`` flies N long legs in gusts that begin and end suddenly, with the wind as estimated in a
supervised flight, and counts the reports of a lost package; half of them have a loss. ``--far N`` flies N far deliveries (`benchmarks.link.proof.far`): minutes
of cruise, strong wind that grows with height, changes of speed, packages of any weight, weak batteries; half of them fail.
"""

"""An independent judge: another world, which shares no code and no assumption with planner, evaluation and models.

    python -m benchmarks.independent --worlds ours,without-JFK,weather --requests 10 --days 10 --out flown.jsonl

What is true: `reports` (raw records), `series` (wind between reports), `wind` (between sites), `profile` (above 10 m), `turbulence`,
`craft` (motion), `energy`, `battery`, `pads` (strangers). `ground` is the map. `build` puts the parts of one of the `worlds` together for an
order; `delivery` flies it, and tells a policy only what `information` says. `study` draws orders, `screening` says which are flown with decisions in the air, `verdict` counts, `statistics`
gives intervals.
`product.planning` and `product.policies` are the only doors to the product: plans, decisions, network data, and the simulated vehicle's power.

The world "ours" deviates in nothing: there it must say what the product's own evaluation says, and a test holds it to that. Judged by day:
a plan is made without some days of the record, and flown on them. What is not simulated: decisions in the air elsewhere than over stations
(turning back, diverting, another station while hovering), other drones that react, power limits of pads.
"""

"""An independent judge: another world, which shares no code and no assumption with planner, evaluation and models.

    python -m benchmarks.independent --worlds ours,without-JFK,weather --requests 10 --days 10 --out flown.jsonl

What is true: `reports` (raw records), `series` (wind between reports), `wind` (between sites), `profile` (above 10 m), `turbulence`,
`craft` (motion), `energy`, `battery`, `pads` (strangers). `ground` is the map. `build` puts the parts of one of the `worlds` together for an
order; `delivery` flies it, and tells a policy only what `information` says. `study` draws orders, `screening` says which are flown with decisions in the air, `verdict` counts, `statistics`
gives intervals. `left_out` judges promises as flown by leaving the days of a season out in turn.
Only the modules of `product` know the product: plans, network data and the simulated vehicle's power (`planning`), what decides on the ground (`policies`, `supervised`) and in the air (`in_air`).

The world "ours" deviates in nothing: there it must say what the product's own evaluation says, and a test holds it to that. Judged by day:
a plan is made without some days of the record, and flown on them. What is not simulated: going to another station while hovering, other drones that react, power limits of pads.
"""

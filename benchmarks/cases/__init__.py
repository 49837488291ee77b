"""Networks, loads and deliveries that benchmarks are run on."""

"""Base maps beneath the network: MBTiles, PMTiles, or a tile server that the operator names."""

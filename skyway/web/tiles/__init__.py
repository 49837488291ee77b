"""Base maps beneath the network: MBTiles, PMTiles, or a tile server named by the operator."""

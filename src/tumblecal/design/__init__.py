"""Design of a measurement before it begins: positions and their order, from the rig, to a plan with its promises."""

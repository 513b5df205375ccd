"""The .cwa file of an Axivity AX6: blocks and their clock."""

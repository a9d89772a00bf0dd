"""The neural modules and the enhanced BRDF (section 3 and Fig. 3 of the paper)."""

"""From camera tracks of real particles to landings, estimates, and a comparison with prediction."""

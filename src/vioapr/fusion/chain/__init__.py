"""Method `chain`: where the tracking world lies in the map, smoothed as a random walk."""

"""A model of the stock C client, from reading clients 2.0.0 to 3.0.1, and a tap that has it read what tests send."""

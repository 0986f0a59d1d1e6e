"""The second part: sales of the store among posts, people, moved goods and failures."""

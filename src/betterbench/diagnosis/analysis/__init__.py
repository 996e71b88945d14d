"""Analysis of one episode: its trace, approaches, grasp attempts, halts, collisions and harm."""

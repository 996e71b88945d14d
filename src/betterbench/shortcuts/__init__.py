"""The shortcut audit: what goes together in demonstrations, and which variations a learner of them would fail."""

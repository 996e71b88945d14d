"""Visual questions whose answers the records prove, and whether a policy's model knows what the policy fails to do."""

"""What is fitted: observations with their conditions, gathered from recordings and checked."""

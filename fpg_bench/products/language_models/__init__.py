"""A large language model as planner, behind any OpenAI-compatible server."""

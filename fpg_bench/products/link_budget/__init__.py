"""Link budgets of scenarios of the model link."""

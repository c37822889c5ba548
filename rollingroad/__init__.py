"""The application: the chain, the evaluation, the gap diagnosis, the views and the command."""

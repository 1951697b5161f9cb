"""The thesis figure by figure: what is published beside the same made here."""

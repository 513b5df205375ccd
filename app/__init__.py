"""The Acromion application: accounts, storage, jobs, pages, API and reports."""

"""Who may do what, and when: policy, permission, the control lease, attendance. No model can change any of it."""

"""Who may do what, and when: policy, permissions, the control lease, attendance. No model can change any of it."""

"""Search Param Models q_φ: is the truth higher than this candidate?"""

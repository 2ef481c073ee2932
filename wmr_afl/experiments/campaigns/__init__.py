"""Campaigns: many runs drawn from distributions, block by block, here or on a cluster, interrupted and gone on with."""

from wmr_afl.experiments.campaigns.result import CampaignResult
from wmr_afl.experiments.campaigns.runner import campaign, replay

__all__ = ["CampaignResult", "campaign", "replay"]

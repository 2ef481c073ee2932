"""Campaigns: many runs drawn from distributions, in blocks, here or on a cluster; continued if interrupted."""

from wmr_afl.experiments.campaigns.result import CampaignResult
from wmr_afl.experiments.campaigns.runner import campaign, campaign_folder, compare, replay

__all__ = ["CampaignResult", "campaign", "campaign_folder", "compare", "replay"]

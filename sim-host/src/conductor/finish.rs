//! The regular end of a run: all nodes are told to stop, and asked what they have to report.

use super::contact::TIMES;
use super::{Conductor, HubError, Received, STOP};
use funnelnet_protocol::message::Message;
use funnelnet_protocol::report::Report;
use funnelnet_protocol::serial;
use funnelnet_protocol::service::{Reply, Request};

impl Conductor {
    pub(super) async fn stop(&mut self) -> Result<Vec<Option<Report>>, HubError> {
        // All of them first: nodes with clocks of their own tick on until they hear it.
        self.stop_on_can().await?;
        for index in 0..self.nodes.len() {
            if let Err(error) = self.tell_to_stop(index).await {
                self.lose(index, error).await?;
            }
        }
        let mut reports = Vec::new();
        for index in 0..self.nodes.len() {
            reports.push(match self.ask_for_report(index).await {
                Ok(report) => report,
                Err(error) => {
                    self.lose(index, error).await?;
                    None
                }
            });
        }
        self.ask_who_was_told().await?;
        self.listen_on_can().await?;
        Ok(reports)
    }

    async fn tell_to_stop(&mut self, index: usize) -> Result<(), HubError> {
        match self.nodes.get_mut(index) {
            Some(node) if node.is_here() && !node.stopped => node.contact.write(&serial::encode(&STOP)).await,
            _ => Ok(()),
        }
    }

    async fn ask_for_report(&mut self, index: usize) -> Result<Option<Report>, HubError> {
        let Some(node) = self.nodes.get_mut(index).filter(|node| node.is_here()) else {
            return Ok(None);
        };
        let mut faults = Vec::new();
        let pick = |received| match received {
            Received::Message(message @ Message::Fault { .. }) => {
                faults.push(message);
                None
            }
            received => report(received),
        };
        let patience = (self.patience.answer, self.patience.answer / TIMES);
        let reported = node.contact.ask(&Request::Report, patience, "report", pick).await;
        self.note_warnings(index, &faults);
        reported.map(Some)
    }
}

/// What a node answers to the last request of a run.
pub(super) fn report(received: Received) -> Option<Report> {
    match received {
        Received::Reply(Reply::Report(report)) => Some(report),
        _ => None,
    }
}

use crate::Arm;
use proact_bridge::PageContent;
use proact_testbed::Testbed;

/// What the page shows of a trial that nobody drives, and with no other method to choose from.
pub fn page_content(testbed: &Testbed, arm: &Arm) -> PageContent {
    let config = testbed.config();
    PageContent {
        title: format!("Method {}", config.method_label()),
        setup: config.setup.name.clone(),
        arm: testbed.model().as_ref().clone(),
        meshes: arm.meshes(),
        scene: testbed.task().scene().clone(),
        briefing: testbed.task().briefing().clone(),
        interactive: false,
        lean: false,
        method: testbed.method().clone(),
        methods: Vec::new(),
    }
}

/// The same of a trial that the person at the page drives.
pub fn driven_page_content(testbed: &Testbed, arm: &Arm) -> PageContent {
    let lean = testbed.config().setup.body.forward_max_deg > 0.0;
    PageContent { interactive: true, lean, ..page_content(testbed, arm) }
}

import{i as o}from"./chunk-VMOTANUS.js";var r=o([]);export{r as a};
